#!/usr/bin/env bash
# A real Prometheus scrapes a real coordinator and worker with the files of deploy/prometheus, and sees a job go by.
# Needs prometheus and promtool (Debian: apt-get install prometheus), on the path or in the folder $PROMETHEUS.
# Ports 9464, 9465 and 19090 of the loopback interface have to be free.
set -euo pipefail
cd "$(dirname "$0")/.."
[ -z "${PROMETHEUS:-}" ] || PATH="$PROMETHEUS:$PATH"
for program in prometheus promtool curl; do
    command -v "$program" >/dev/null || { echo "tests/prometheus.sh: $program is missing (Debian: apt-get install prometheus curl)" >&2; exit 1; }
done

profile=${PROFILE:-release}
if [ "$profile" = release ]; then cargo build --locked --quiet --release --bins; else cargo build --locked --quiet --bins; fi
bin=$PWD/target/$profile
out=$(mktemp -d)
started=()
trap 'kill "${started[@]}" 2>/dev/null || true; wait; rm -rf "$out"' EXIT
fail() { echo "tests/prometheus.sh: $1" >&2; tail -n 5 "$out"/*.log >&2; exit 1; }

promtool check config deploy/prometheus/prometheus.yml
sed 's/15s/1s/' deploy/prometheus/prometheus.yml > "$out/prometheus.yml"
cp deploy/prometheus/alerts.yml "$out"

"$bin/coordinator" --listen 127.0.0.1:0 --store "sqlite:$out/store.db" --metrics 127.0.0.1:9464 > "$out/address" 2> "$out/coordinator.log" &
started+=($!)
for _ in $(seq 100); do grep -q listening "$out/address" && break; sleep 0.1; done
url=http://$(sed -n 's/^listening on //p' "$out/address")
"$bin/worker" --coordinator "$url" --slots 2 --metrics 127.0.0.1:9465 2> "$out/worker.log" &
started+=($!)
prometheus --config.file="$out/prometheus.yml" --storage.tsdb.path="$out/data" --web.listen-address=127.0.0.1:19090 2> "$out/prometheus.log" &
started+=($!)

# The value of a query, or nothing.
ask() { curl -sG http://127.0.0.1:19090/api/v1/query --data-urlencode "query=$1" | sed -n 's/.*"value":\[[^,]*,"\([^"]*\)"\].*/\1/p'; }
until_is() {
    for _ in $(seq 240); do [ "$(ask "$1")" = "$2" ] && return; sleep 0.5; done
    fail "$1 is '$(ask "$1")' and not $2"
}

until_is 'sum(up)' 2
until_is 'evogait_slots' 2
until_is 'evogait_rounds_sealed_total' 0
EVOGAIT_COORDINATOR=$url "$bin/evogait" submit scenarios/jobs/quadropod-quick.toml > "$out/job.log"
until_is 'evogait_jobs_ended_total{state="succeeded"}' 1
generations=$(sed -n 's/^generations *= *\([0-9]*\).*/\1/p' scenarios/jobs/quadropod-quick.toml)
# Beside the search: the preparation, the finish and the report.
until_is 'evogait_rounds_sealed_total' $((generations + 3))
until_is 'evogait_round_seconds_count' $((generations + 3))
[ "$(ask 'histogram_quantile(0.5, evogait_commit_seconds_bucket) > 0')" ] || fail "the histogram of commits is empty"
[ "$(ask 'evogait_worker_tasks_total > 0')" ] || fail "the worker counts nothing"
# Every series that an alarm looks at is there.
for name in $(grep -o 'evogait_[a-z_]*' deploy/prometheus/alerts.yml | sort -u); do
    [ "$(ask "count($name)")" ] || fail "an alarm uses $name, and no program serves it"
done
[ -z "$(ask 'count(ALERTS)')" ] || fail "an alarm is on: $(ask 'ALERTS')"
echo "Prometheus saw $generations generations of one job."
