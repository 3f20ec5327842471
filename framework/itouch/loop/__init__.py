"""Part of itouch."""
