"""Who touches, and what: a finger's and a sample's thermal parameters from recorded touches, with intervals."""
