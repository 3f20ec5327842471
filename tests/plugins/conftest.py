"""The framework's stores are behind the contact-heat solver in all tests of plugins, whatever is imported first."""

import itouch_thermal  # noqa: F401
