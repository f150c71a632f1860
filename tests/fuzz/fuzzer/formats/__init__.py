"""One module a family of formats: small files made by code, changes that know the form, and the reader to try."""
