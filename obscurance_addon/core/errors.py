"""Errors that the core raises and that operators and the command line turn into reports."""


class ObscuranceError(Exception):
    """Base of all errors whose message is meant for the user: it names what is wrong and the cure."""


class SettingsError(ObscuranceError, ValueError):
    """A setting is outside its range."""


class GeometryError(ObscuranceError):
    """The scene holds nothing that can be baked or traced."""


class BackendError(ObscuranceError):
    """A native library that the bake needs is missing or does not load."""


class BakeCancelledError(ObscuranceError):
    """The user cancelled; nothing has been written."""
