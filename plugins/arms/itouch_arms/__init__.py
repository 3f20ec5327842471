"""Haptic arms driven through their makers' software: Haply's Inverse Service, and OpenHaptics for Phantom and Touch."""
