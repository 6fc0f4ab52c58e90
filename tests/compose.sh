#!/usr/bin/env bash
# The compose cluster of deploy/compose.yaml for real, as docs/deploy.md tells it: images, two commands to a result; a job
# from outside under a killed, a paused and a cut-off worker and a coordinator that starts again; a failover to the
# standby; the dashboard's queries on a Prometheus. Results have the bits that `evogait run` gives.
#
#   tests/compose.sh
#
# Needs root, Docker with Compose, debootstrap, curl, python3 and the release binaries (they are built). Takes about
# 5 minutes, and 3 more where deploy/images/local.sh has made no base images yet. Leaves images behind, and nothing else.
set -euo pipefail
cd "$(dirname "$0")/.."
root=$PWD
for tool in docker debootstrap curl python3 strip; do
    command -v "$tool" > /dev/null || { echo "compose.sh: $tool is not there" >&2; exit 1; }
done
work=$(mktemp -d)
. tests/page.sh
docker compose version > /dev/null || { echo "compose.sh: neither docker compose nor docker-compose is there" >&2; exit 1; }

step() { printf '\n-- %s (%s)\n' "$1" "$(date -u +%H:%M:%S)"; }
fail() { reason=$*; exit 1; }
reason=
trap 'reason="line $LINENO: $BASH_COMMAND"' ERR

# Names and ports of its own, so that it meets no cluster of the user's.
export COMPOSE_PROJECT_NAME=evogait-test-$$
port=$((20000 + RANDOM % 10000))
export EVOGAIT_PUBLISH=127.0.0.1:$port EVOGAIT_PUBLISH_STANDBY=127.0.0.1:$((port + 1)) PROMETHEUS_PORT=$((port + 2))
export EVOGAIT_IMAGE=evogait:test
adapt() { sed "s/localhost:7077/localhost:$port/g"; }
# The local images, as set where no registry can be reached.
set -a
. deploy/images/local.env
set +a
export DOCKER_BUILDKIT=0 COMPOSE_DOCKER_CLI_BUILD=0

compose() { (cd "$root/deploy" && docker compose "$@"); }
clean_up() {
    status=$?
    trap - EXIT INT TERM
    if [ "$status" != 0 ]; then
        compose --profile ha --profile observe --profile tools ps || true
        compose --profile ha --profile observe --profile tools logs --no-color --tail 40 || true
    fi
    # What is paused can't be stopped.
    for container in $(command docker ps -q --filter "label=com.docker.compose.project=$COMPOSE_PROJECT_NAME" --filter status=paused); do
        command docker unpause "$container" > /dev/null || true
    done
    compose --profile ha --profile observe --profile tools down --volumes --remove-orphans --timeout 2 > "$work/down.log" 2>&1 || cat "$work/down.log"
    [ "$status" = 0 ] || echo "compose.sh: ${reason:-ended with $status}" >&2
    rm -rf "$work"
    exit "$status"
}
trap clean_up EXIT
trap 'exit 130' INT TERM

step "binaries and base images"
: "${EVOGAIT_BINARIES:=target/release}"
[ "$EVOGAIT_BINARIES" != target/release ] || cargo build --locked --release --quiet
export EVOGAIT_BINARIES PATH="$root/$EVOGAIT_BINARIES:$PATH"
deploy/images/local.sh runtime postgres prometheus binaries

step "an image is built from what git keeps, and the binaries"
# Builds that run meanwhile come and go in the folders git ignores; an image that is built from them fails by chance.
ignored=$(sed -n 's#^/\([^*]*\)$#\1#p' .gitignore)
[ -n "$ignored" ] || fail ".gitignore names no folders"
for folder in $ignored; do
    mkdir -p "$folder"
    touch "$folder/probe-$$"
done
printf 'FROM %s\nCOPY . /context\n' "$EVOGAIT_RUNTIME_IMAGE" | command docker build --quiet --tag "$EVOGAIT_IMAGE-context" --file - . > /dev/null
for folder in $ignored; do rm "$folder/probe-$$"; done
found=$(command docker run --rm "$EVOGAIT_IMAGE-context" find /context -name "probe-$$")
command docker rmi "$EVOGAIT_IMAGE-context" > /dev/null
[ -z "$found" ] || fail ".dockerignore lets in what git ignores: $found"

step "the image, by BuildKit as well"
# With a client that has it: Docker's own from version 23 on needs buildx for it.
with_buildkit() {
    local client
    for client in $(type -ap docker); do
        DOCKER_BUILDKIT=1 "$client" build --quiet --file deploy/Dockerfile --target prebuilt --build-arg RUNTIME_IMAGE="$EVOGAIT_RUNTIME_IMAGE" \
            --tag "$EVOGAIT_IMAGE-buildkit" . 2> "$work/buildkit.log" && return
    done
    return 1
}
with_buildkit > /dev/null || { cat "$work/buildkit.log" >&2; fail "no client here builds with BuildKit: apt-get install docker-buildx"; }
command docker run --rm --read-only "$EVOGAIT_IMAGE-buildkit" evogait --version
command docker rmi "$EVOGAIT_IMAGE-buildkit" > /dev/null

step "from a clone to a result: two commands"
follow two-commands

step "what runs has no root and nothing to write to"
containers() { command docker ps -q --filter "label=com.docker.compose.project=$COMPOSE_PROJECT_NAME" --filter "label=com.docker.compose.service=$1"; }
container() { containers "$1" | head -n 1; }
for service in coordinator worker; do
    got=$(command docker inspect --format '{{.Config.User}} {{.HostConfig.ReadonlyRootfs}} {{.HostConfig.CapDrop}}' "$(container $service)")
    [ "$got" = "10001:10001 true [ALL]" ] || fail "$service runs as $got"
done
[ "$(containers worker | wc -l)" = 2 ] || fail "there are not two workers"

step "three workers; a client outside"
export HOME=$work/home
mkdir "$HOME"
compose up --detach --scale worker=3
follow outside
export EVOGAIT_COORDINATOR=https://localhost:$port,https://localhost:$((port + 1))
evogait list --json | grep -q '"succeeded"' || fail "the first job did not run on the cluster"
evogait health --quiet || fail "the coordinator is not healthy from outside"

# Long enough for all that is done to it, and no longer.
evogait scenarios show quadropod-empty | sed 's/^generations = 100 .*/generations = 60/' > "$work/job.toml"
grep -q '^generations = 60$' "$work/job.toml" || fail "the job that ships has another number of generations"

# field JSON-FIELD: of the JSON on standard input.
field() { python3 -c 'import json,sys; v=json.load(sys.stdin)
for key in sys.argv[1].split("."): v=v[key]
print(v)' "$1"; }
expected() { evogait run "$work/job.toml" --seed "$1" --out "$work/here-$1" --workers "$(nproc)" --json --quiet | field result_digest; }
generations() { evogait show "$1" --json | field generations_done; }
state() { evogait show "$1" --json | field state; }
# until COUNT JOB: has sealed so many more generations than when called.
until_more() {
    local from now deadline=$((SECONDS + 90))
    from=$(generations "$2")
    while now=$(generations "$2" || echo "$from"); (( now < from + $1 )); do
        (( SECONDS < deadline )) || fail "job $2 stands at generation $now"
        [ "$(state "$2" || true)" != failed ] || fail "job $2 failed"
        sleep 0.2
    done
    echo "   $(date -u +%H:%M:%S) generation $now"
}
all_well() {
    local deadline=$((SECONDS + 60)) service bad
    while :; do
        bad=
        for service in "$@"; do
            for c in $(containers "$service"); do
                [ "$(command docker inspect --format '{{.State.Health.Status}}' "$c")" = healthy ] || bad="$bad $service"
            done
        done
        [ -n "$bad" ] || return 0
        (( SECONDS < deadline )) || fail "not healthy:$bad"
        sleep 1
    done
}
all_well coordinator worker postgres

step "the same jobs on this machine, without a cluster"
want_1=$(expected 1)
want_2=$(expected 2)

step "a job from outside; a worker is killed, one paused, one cut off, the coordinator started again"
mapfile -t worker < <(containers worker)
network=${COMPOSE_PROJECT_NAME}_workers
job=$(evogait submit "$work/job.toml" --seed 1)
until_more 2 "$job"
command docker kill --signal KILL "${worker[0]}" > /dev/null
echo "   killed one"; until_more 2 "$job"
command docker pause "${worker[1]}" > /dev/null
echo "   paused one"; until_more 2 "$job"
command docker start "${worker[0]}" > /dev/null
command docker network disconnect "$network" "${worker[2]}"
echo "   cut one off"; until_more 2 "$job"
command docker unpause "${worker[1]}" > /dev/null
compose restart coordinator > /dev/null 2>&1
echo "   the coordinator starts again"; until_more 2 "$job"
command docker network connect "$network" "${worker[2]}"
[ "$(state "$job")" != succeeded ] || fail "the job ended before all was done to it: it must be longer"
evogait watch "$job" --quiet
evogait fetch "$job" --out "$work/disturbed" --json --quiet | field result_digest > "$work/got"
[ "$(cat "$work/got")" = "$want_1" ] || fail "the digest is $(cat "$work/got") and on this machine $want_1"
echo "   digest $want_1, as on this machine"

step "a worker that is stopped drains within its grace"
compose stop worker > /dev/null 2>&1
for c in "${worker[@]}"; do
    [ "$(command docker inspect --format '{{.State.ExitCode}}' "$c")" = 0 ] || fail "a stopped worker did not end with 0"
done
compose up --detach --scale worker=3 > /dev/null 2>&1

step "profile ha: the active coordinator is killed"
follow ha
all_well standby
job=$(evogait submit "$work/job.toml" --seed 2)
until_more 2 "$job"
command docker kill --signal KILL "$(container coordinator)" > /dev/null
echo "   killed the active coordinator"; until_more 2 "$job"
compose --profile ha start coordinator > /dev/null 2>&1
echo "   it is back and stands by"
evogait watch "$job" --quiet
evogait fetch "$job" --out "$work/failover" --json --quiet | field result_digest > "$work/got"
[ "$(cat "$work/got")" = "$want_2" ] || fail "the digest is $(cat "$work/got") and on this machine $want_2"
echo "   digest $want_2, as on this machine"

step "profile observe: the dashboard's queries on a Prometheus"
compose --profile observe up --detach --no-deps prometheus > /dev/null 2>&1
python3 tests/dashboard.py deploy/compose/grafana/dashboards/evogait.json "http://127.0.0.1:$PROMETHEUS_PORT"

step "done"
