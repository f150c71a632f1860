"""Names of channels are taken apart in one place."""

import pytest

from dynreg.data.names import joint_of, parts_of, quantity_of


@pytest.mark.parametrize(
    ("name", "joint", "quantity"),
    [
        ("arm/position", "arm", "position"),
        ("supply", "supply", ""),
        ("fl/hip/velocity", "fl", "hip/velocity"),
    ],
)
def test_a_name_is_a_joint_and_a_quantity(name: str, joint: str, quantity: str):
    assert parts_of(name) == (joint, quantity) == (joint_of(name), quantity_of(name))
