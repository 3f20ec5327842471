"""A fingertip touches wood without contact resistance: the first moments, exact, and on a mesh of 0.1 mm."""

import itouch_thermal as heat
from contact_heat.differences import solve_differences

tissue = heat.Layer(name="tissue", thickness=0.02, conductivity=0.4, density=1000.0, specific_heat=3500.0)
wood = heat.Layer(name="wood", thickness=0.02, conductivity=0.11, density=415.0, specific_heat=2720.0)
insulated = heat.Back(kind="insulated")
touch = heat.Contact(
    finger=heat.Side(layers=(tissue,), initial=heat.Initial(kind="uniform", temperature=306.15), back=insulated),
    object=heat.Side(layers=(wood,), initial=heat.Initial(kind="uniform", temperature=296.15), back=insulated),
    resistance=0.0,
)
times = [1e-3, 1e-2, 0.1, 1.0, 10.0]
exact = heat.solve(touch, times).flux
mesh = solve_differences(touch, times, split=False).flux
split = solve_differences(touch, times).flux

print("  after     exact, W/m2      mesh     split")
for time, flux, plain, better in zip(times, exact, mesh / exact - 1, split / exact - 1, strict=True):
    print(f"{time:6g} s   {flux:11.0f}   {plain:+7.1%}   {better:+7.2%}")
