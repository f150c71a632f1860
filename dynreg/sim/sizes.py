"""The sizes of an effect, in words; without heavy imports, for results and settings name them, too."""

from typing import Literal, get_args

Size = Literal["weak", "medium", "strong"]
SIZES: tuple[Size, ...] = get_args(Size)
