#!/usr/bin/env bash
# The plugin kit from the built wheel, in a new environment and an empty folder: the tutorial from its first line to its last.
# With a wheel as its argument it builds none.
set -euo pipefail
cd "$(dirname "$0")/.."
export PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_ROOT_USER_ACTION=ignore PIP_NO_WARN_SCRIPT_LOCATION=1
out=$(mktemp -d)
trap 'rm -rf "$out"' EXIT
if [ "$#" -gt 0 ]; then
  cp "$1" "$out"
else
  python3 -m venv "$out/build"
  "$out/build/bin/pip" install -q build
  "$out/build/bin/python" -m build -q --wheel --outdir "$out" .
fi
cp docs/tutorials/plugin-in-a-day.md tests/scaffold/tutorial.py "$out"
python3 -m venv "$out/venv"
"$out/venv/bin/pip" install -q "$out"/*.whl
cd "$out"
env -u PYTHONPATH "$out/venv/bin/python" tutorial.py plugin-in-a-day.md "$out/work"
