"""How well the display renders: contacts in closed loop on the twin, without a scene, and bounds on the result."""
