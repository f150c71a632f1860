"""Tables and HTML pages of frozen results; nothing is computed here."""
