#!/usr/bin/env bash
# The same gaits on the same robots in our two engines and in MuJoCo: speed, fidelity, agreement. See README.md beside this.
#
#   tests/peers/run.sh                      measure the quadropod and the lizard (some minutes; a quiet machine, please)
#   tests/peers/run.sh ROBOT …              measure these robots that ship, NAME:VARIANT, random:INDEX
#   tests/peers/run.sh --brief ROBOT …      only defaults and finest settings: a line a robot
#   tests/peers/run.sh --quick              only check that all engines have the same robots (CI)
#   tests/peers/run.sh --standing [COUNT]   check that random robots come to rest here as they do in MuJoCo
#   tests/peers/run.sh --help               all options
#
# PEERS_PROFILE=dev uses an unoptimised build of our command: good for correctness, not for speeds.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
cd "$here/../.."
target=${CARGO_TARGET_DIR:-target}
profile=${PEERS_PROFILE:-release}
venv=$target/peers/venv

fail() { echo "tests/peers: $*" >&2; exit 1; }

system=$(command -v python3) || fail "python3 is missing: install Python 3.11 or newer"
"$system" -c 'import sys; sys.exit(sys.version_info < (3, 11))' || fail "$("$system" --version) is too old: 3.11 or newer is needed"

# The environment is made once, and again when the pinned versions change.
if ! cmp -s "$here/requirements.txt" "$venv/requirements.txt"; then
    rm -rf "$venv"
    mkdir -p "$(dirname "$venv")"
    "$system" -m venv "$venv" || fail "python3 can't make an environment: install its venv module (python3-venv)"
    "$venv/bin/python" -m pip install --quiet --disable-pip-version-check --requirement "$here/requirements.txt" ||
        fail "a pinned package can't be installed: see above and $here/requirements.txt"
    cp "$here/requirements.txt" "$venv/requirements.txt"
fi

case $profile in
    release) folder=release ;;
    dev) folder=debug ;;
    *) fail "PEERS_PROFILE = \"$profile\" is unknown: release or dev" ;;
esac
cargo build --locked --quiet --profile "$profile" --bins # all of them: physics is then built once for all scripts
python() { "$venv/bin/python" -B "$here/$1" "${@:2}"; }
standing() { python standing.py --standing "$target/$folder/peer_standing" --work "$target/peers" "$@"; }
if [ "${1:-}" = --standing ]; then
    standing "${@:2}"
    exit
fi
exec "$venv/bin/python" -B "$here/compare.py" \
    --evogait "$target/$folder/evogait" --rollouts "$target/$folder/peer_rollouts" --work "$target/peers" "$@"
