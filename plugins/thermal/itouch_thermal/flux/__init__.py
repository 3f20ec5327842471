"""Flux control: the one current that makes the finger feel the flux that the real object would draw."""
