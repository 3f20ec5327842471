"""Identification: the thermal parameters of a finger and a sample from recorded touches, with intervals."""
