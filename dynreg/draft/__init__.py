"""Draft: a robot folder made of a model that others wrote, and of a log where there is one."""
