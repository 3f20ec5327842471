"""The contact-heat solver: layered sides, exact evaluation, live stepping, the paper's scheme, batches.

Sign of every flux: positive when heat leaves the finger.  Temperatures are kelvin; depths are measured from
the contact inwards on each side.
"""
