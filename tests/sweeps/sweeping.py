"""Small sweeps of the smallest scene, for tests."""

from __future__ import annotations

import shutil
from pathlib import Path

from shipped import SCENES

HEAD = '<sweep version="1.0" scene="first_touch.xml" seed="3">'
COLLECT = """<collect>
    <report name="force" key="contacts[0].peak_force_N"/>
    <field name="push" of="finger.force" index="2" reduce="max"/>
    <field name="touching" of="finger.penetration" reduce="above" begin="0.2 s"/>
    <call name="own" function="own.py:count" results="ticks seed"/>
  </collect>"""
VARIED = """<grid name="mass" set="operator.mass" values="60 80" unit="g"/>
  <draws kind="sobol" count="2"><over name="stiffness" set="wood/contact.stiffness" low="0.8" high="1.6" unit="N/mm"/></draws>
  <seeds count="2"/>"""
OWN = """def count(session):
    return {"ticks": session.ticks, "seed": int(session.state["seed"])}
"""


def written(folder: Path, inside: str = VARIED + COLLECT, own: str = OWN) -> Path:
    """Write a sweep of the smallest scene, with its scene and its functions; return its file."""
    folder.mkdir(exist_ok=True)
    shutil.copy(SCENES / "first_touch.xml", folder)
    (folder / "own.py").write_text(own, encoding="utf-8")
    path = folder / "sweep.xml"
    path.write_text(f"{HEAD}\n  {inside}\n</sweep>\n", encoding="utf-8")
    return path
