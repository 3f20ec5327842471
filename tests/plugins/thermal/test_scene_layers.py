"""Layers of fingers and samples as scenes give them: what cannot be is said beside its element, the rest works."""

import pytest

import itouch
from contact_heat.layers import MOST_LAYERS

TISSUE = 'conductivity="0.3 W/(m*K)" density="1 g/cm^3" specific-heat="3 kJ/(kg*K)"'
THICK = f'{TISSUE} thickness="1 mm"'
SCENE = """<itouch version="1.0" xmlns:f="urn:itouch:plugin:touch-film" xmlns:t="urn:itouch:plugin:thermal">
<include file="itouch:materials.xml"/>
<devices>
<device name="stick" plugin="usb-arm"/>
<device name="pad" plugin="touch-film"><f:hardware hold="0.5 s" pause="0.5 s" touches="1">{pad}</f:hardware></device>
<device name="plate" plugin="thermal"><t:hardware>{plate}</t:hardware></device>
</devices>
<world><box name="b" size="60 60 20 mm" material="wood"/></world>
<interaction><probe name="tip" pose-from="stick" force-to="stick"/><t:heat probe="tip">{heat}</t:heat></interaction>
</itouch>"""


def _scene(folder, **inside):
    path = folder / "layers.xml"
    path.write_text(SCENE.format(**({"pad": "", "plate": "", "heat": ""} | inside)), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("inside", "element", "said"),
    [
        ({"heat": f"<t:layer {TISSUE}/>"}, "<t:heat>", "<layer> 1 has no thickness"),
        ({"plate": f'<t:tissue {THICK}/><t:tissue name="fat" {TISSUE}/>'}, "<t:hardware>", "<tissue> fat has no thick"),
        ({"pad": f"<f:tissue {TISSUE}/>"}, "<f:hardware>", "<tissue> 1 has no thickness"),
        ({"pad": f"<f:sample {TISSUE}/><f:sample {THICK}/>"}, "<f:hardware>", "only the last <sample> may go on"),
        ({"pad": f'<f:sample {THICK} perfusion="9"/>'}, "<f:hardware>", "only a finger has blood"),
        ({"pad": f"<f:tissue {THICK}/>" * (MOST_LAYERS + 1)}, "<f:hardware>", f"at most {MOST_LAYERS} may be"),
        ({"pad": f"<f:sample {THICK}/>" * MOST_LAYERS}, "<f:hardware>", f"at most {MOST_LAYERS - 1} may be"),
    ],
)
def test_layers_that_cannot_be_are_said_beside_their_element(tmp_path, inside, element, said):
    with pytest.raises(itouch.SceneError) as caught:
        itouch.build(_scene(tmp_path, **inside))
    (problem,) = caught.value.problems
    assert problem.code == "bad-value"
    assert element in problem.sentence and said in problem.sentence


def test_a_sample_without_an_end_draws_what_a_very_deep_one_does(tmp_path):
    fluxes = []
    for end in ("", ' thickness="1 m"'):
        session = itouch.build(_scene(tmp_path, pad=f"<f:sample {TISSUE}{end}/>"))
        session.run(0.9)
        fluxes.append(session.state["pad.twin.true_flux"].item())
    assert fluxes[0] > 300.0
    assert fluxes[0] == pytest.approx(fluxes[1], rel=1e-3)
