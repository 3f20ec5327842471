"""Devices, channels, fields and commands of any names are driven, limited and reported as ours are, bit for bit."""

from __future__ import annotations

import weakref

import numpy as np
import pytest
from renamed import OURS, QUIET, Alias, commanded, scene

from itouch.plugin.device import TwinInputs
from itouch.testing.harness import DeviceHarness
from itouch_evidence.renamed import RenamedCatalog

STRANGE = ("qua", "wob", "zig", "fulmar")
KINDS = {
    "current": (f"{QUIET}", "", ""),
    "paper": (QUIET, 'controller="paper"', ""),
    "temperature": (f'{QUIET} command="temperature"', "", 'flux-control="50 Hz"'),
}


@pytest.fixture(scope="module", params=KINDS)
def ours(request):
    hardware, control, rates = KINDS[request.param]
    found, session = commanded(scene(OURS, hardware, control, rates))
    return request.param, found, session.report()


def plain(report: dict) -> tuple:
    """Return what does not depend on the machine or on the names of devices."""
    return report["contacts"], [d["limited"] for d in report["devices"].values()], report["faults"]


def test_the_scene_with_the_original_names_touches_and_drives(ours):
    kind, found, report = ours
    assert len(report["contacts"]) == 1 and report["contacts"][0]["mean_flux_W_m2"] is not None
    assert len({tuple(row[-2:]) for row in found}) > (20 if kind == "temperature" else 100)
    assert not report["faults"]


def test_other_names_of_channels_and_fields_change_no_bit(ours):
    kind, found, report = ours
    other, session = commanded(scene(OURS, *KINDS[kind]), RenamedCatalog(seed=11))
    assert not {"peltier.plate_temperature", "peltier.sent.current", "heat.desired"} & set(session.state)
    assert other == found
    assert plain(session.report()) == plain(report)


def test_other_names_of_devices_and_of_the_plugin_change_no_bit(ours):
    kind, found, report = ours
    other, session = commanded(scene(STRANGE, *KINDS[kind]), Alias(12, "fulmar"), names=STRANGE)
    assert other == found
    assert plain(session.report()) == plain(report)


def test_a_twin_behind_other_names_keeps_none_of_the_records_that_it_is_given():
    bench = DeviceHarness(RenamedCatalog(seed=3).device("xyz-table"), "xyz-table").bench()
    bench.step(2)
    reading, command = bench.reading.copy(), bench.command.copy()
    for call, record in (
        (lambda it: bench.twin.read(bench.state, it), reading),
        (lambda it: bench.twin.step(bench.state, it, TwinInputs(), 1e-3), command),
    ):
        memory = record.raw
        while isinstance(memory.base, np.ndarray):
            memory = memory.base
        watched = weakref.ref(memory)
        call(record)
        assert watched() is not None
    del reading, command, record, memory
    assert watched() is None
