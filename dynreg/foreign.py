"""Text from elsewhere, fit to be shown: what a terminal or a browser would obey instead becomes a visible escape."""

import re

# Controls, formatting characters (bidi overrides, zero width), separators of lines, and halves of surrogate pairs:
# Unicode's categories Cc, Cf, Zl, Zp and Cs.
_OBEYED = re.compile(
    "[\x00-\x1f\x7f-\x9f\xad\u0600-\u0605\u061c\u06dd\u070f\u0890\u0891\u08e2\u180e\u200b-\u200f\u2028-\u202e"
    "\u2060-\u206f\ufeff\ufff9-\ufffb\U000110bd\U000110cd\U00013430-\U0001345f\U0001bca0-\U0001bca3"
    "\U0001d173-\U0001d17a\U000e0000-\U000e007f\ud800-\udfff]"
)


def visible(text: str, keep: str = "") -> str:
    r"""The text with every character that is obeyed, not shown, as Python would write it; those in `keep` stay.

    >>> print(visible("red\x1b[31m\r\n"), visible("two\nlines\x00", keep="\n").splitlines())
    red\x1b[31m\r\n ['two', 'lines\\x00']
    """
    return _OBEYED.sub(lambda m: m[0] if m[0] in keep else _escaped(m[0]), text)


def _escaped(character: str) -> str:
    return ascii(character)[1:-1]
