"""The quadruped with short trials."""

from brief_quadruped import brief, brief_folder, quadruped, short_log  # noqa: F401  fixtures
