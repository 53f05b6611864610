#!/usr/bin/env bash
# Builds the wheel kestrel-drones with maturin, installs it beside gymnasium and PettingZoo, and tests it.
#
#   tests/python-package.sh          one task of each family
#   WHOLE=1 tests/python-package.sh  every shipped task
#
# maturin packs what tests/programs.sh has built, so that nothing is compiled with other features a second time.
# Ends with "N passed, N failed".
set -euo pipefail
cd "$(dirname "$0")/.."
# shellcheck source=tests/packages.sh
. tests/packages.sh
# shellcheck source=tests/programs.sh
. tests/programs.sh

venv=target/venv-wheel
python_environment $venv tests/python-package/requirements.txt
programs
wheels=$(mktemp -d)
trap 'rm -r "$wheels"' EXIT
PATH="$PWD/tests/python-package/bin:$PATH" $venv/bin/maturin build --quiet --profile dev \
  --manifest-path trainer-host/python/Cargo.toml --interpreter $venv/bin/python --out "$wheels"
$venv/bin/python -m pip install -q --disable-pip-version-check --no-deps --no-index --force-reinstall "$wheels"/*.whl
status=0
# Not from here, where folders bear the names of what is installed.
nice -n 10 $venv/bin/python -m pytest -q -p no:cacheprovider tests/python-package --junit-xml "$wheels/report.xml" || status=$?
$venv/bin/python - "$wheels/report.xml" <<'EOF'
import sys
import xml.etree.ElementTree as tree

suite = tree.parse(sys.argv[1]).getroot()[0]
failed = int(suite.get("failures")) + int(suite.get("errors"))
print(f"{int(suite.get('tests')) - failed} passed, {failed} failed")
EOF
exit $status
