"""Haptic arms behind their makers' own software: Haply's local service, and OpenHaptics for Phantom and Touch."""
