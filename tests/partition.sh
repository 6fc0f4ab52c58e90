#!/usr/bin/env bash
# Coordinator and worker on two hosts (network namespaces, joined by a veth pair), with real packet loss between them:
# one way, the other way, both, a link of 20 kB/s, and a coordinator with a host that vanishes while another one begins
# at a second address. After each fault the job must progress within 30 s, and in the end have the bits that it has on
# one machine; a watcher on the other host must see its end. The TCP proxy of the tests can't show this: lost packets,
# half-open connections, the kernel's timers. Needs root, ip, nft and tc; nothing touches the machine's own network.
#
#   tests/partition.sh [SECONDS]      how long each partition lasts; 6 unless given (a lease lasts 2)
set -euo pipefail
cd "$(dirname "$0")/.."
seconds=${1:-6}
for tool in ip nft tc; do
    command -v "$tool" > /dev/null || { echo "tests/partition.sh needs $tool" >&2; exit 1; }
done
[ "$(id -u)" = 0 ] || { echo "tests/partition.sh needs root: it makes network namespaces" >&2; exit 1; }

cargo build --locked --quiet --workspace --bins --tests # as cargo test builds them
bin=$(realpath "${CARGO_TARGET_DIR:-target}/debug")
dir=$(mktemp -d)
one=evogait-c$$ other=evogait-w$$
pids=()
clean() {
    for pid in "${pids[@]}"; do
        kill -9 "$pid" 2> /dev/null || true
        wait "$pid" 2> /dev/null || true
    done
    ip netns del "$one" 2> /dev/null || true
    ip netns del "$other" 2> /dev/null || true
}
trap clean EXIT
fail() { tail -n 5 "$dir"/*.log >&2; echo "partition failed: $1; logs in $dir" >&2; exit 1; }

ip netns add "$one"
ip netns add "$other"
ip link add evo-c netns "$one" type veth peer name evo-w netns "$other"
ip -n "$one" addr add 10.77.0.1/24 dev evo-c
ip -n "$one" addr add 10.77.0.3/32 dev evo-c # of its own: the other way its packets would come from the first one
ip -n "$other" addr add 10.77.0.2/24 dev evo-w
for namespace in "$one" "$other"; do
    ip -n "$namespace" link set lo up
    ip netns exec "$namespace" nft add table ip evogait
    ip netns exec "$namespace" nft 'add chain ip evogait out { type filter hook output priority 0; }'
done
ip -n "$one" link set evo-c up
ip -n "$other" link set evo-w up

cat > "$dir/job.toml" << 'TOML'
name = "partition"
robot = "quadropod"
environment = "empty"
[gaits]
count = 2
duration = 2.0
[planner]
iterations = 5
[fitness]
kind = "coverage"
[optimiser]
kind = "pso"
particles = 10
generations = 400
[physics]
engine = "lockstep"
[finish]
kind = "none"
TOML

# On one machine, undisturbed.
digest() { sed -n 's/^ *"result_digest": *"\([0-9a-f]*\)".*/\1/p' "$1/result.json"; }
"$bin/evogait" run "$dir/job.toml" --out "$dir/undisturbed" --quiet > /dev/null
expected=$(digest "$dir/undisturbed")
[ -n "$expected" ] || fail "no digest of the undisturbed run"

first=http://10.77.0.1:7077 second=http://10.77.0.3:7077
coordinator() { # ADDRESS NAME
    ip netns exec "$one" "$bin/coordinator" --listen "$1" --insecure-bind --lease-seconds 2 \
        --store "sqlite:$dir/store.db" > "$dir/$2.out" 2> "$dir/$2.log" &
    coordinator=$!
    pids+=("$coordinator")
    for _ in $(seq 100); do grep -q listening "$dir/$2.out" && return; sleep 0.1; done
    fail "the coordinator does not start"
}
coordinator 10.77.0.1:7077 coordinator
url=$first
ip netns exec "$other" env EVOGAIT_FAULT=slow@ms=20 "$bin/worker" --coordinator "$first,$second" --slots 2 --keepalive 2 2> "$dir/worker.log" &
pids+=($!)
evogait() { ip netns exec "$one" "$bin/evogait" "$@" --coordinator "$url"; }
id=$(evogait submit "$dir/job.toml")
ip netns exec "$other" "$bin/evogait" watch "$id" --coordinator "$first,$second" > "$dir/watch.out" 2> "$dir/watch.log" &
watching=$!
pids+=("$watching")
# Evaluations that are in the store.
progress() { evogait show "$id" --json | sed -n 's/^ *"\(evaluations\)": *\([0-9]*\),*$/\2/p'; }
state() { evogait show "$id" --json | sed -n 's/^ *"state": *"\([a-z]*\)".*/\1/p'; }
gets_on() { # WHAT: from now on within 30 s
    local before start
    before=$(progress) start=$SECONDS
    while [ "$(progress)" -le "$before" ]; do
        [ "$(state)" != succeeded ] || break
        [ $((SECONDS - start)) -lt 30 ] || fail "no progress for 30 s after $1"
        sleep 0.2
    done
    echo "after $1: progress again within $((SECONDS - start + 1)) s ($before evaluations)"
}
block() { ip netns exec "$1" nft add rule ip evogait out drop; }
open() { ip netns exec "$1" nft flush chain ip evogait out; }

gets_on "the start"
block "$other"; sleep "$seconds"; open "$other"
gets_on "$seconds s in which the worker could not be heard"
block "$one"; sleep "$seconds"
# The client runs on the coordinator's host, so its packets still arrive.
open "$one"
gets_on "$seconds s in which the worker heard nothing"
block "$one"; block "$other"; sleep "$seconds"; open "$one"; open "$other"
gets_on "$seconds s of silence"
ip netns exec "$other" tc qdisc add dev evo-w root tbf rate 160kbit burst 4kb latency 200ms
gets_on "the link became slow"
ip netns exec "$other" tc qdisc del dev evo-w root
# None of its last packets arrives, and its address no longer answers: the connections are half-open.
ip netns exec "$one" nft add rule ip evogait out ip saddr 10.77.0.1 drop
kill -9 "$coordinator"
wait "$coordinator" 2> /dev/null || true
coordinator 10.77.0.3:7077 second
url=$second
gets_on "the coordinator's host was gone and another one began elsewhere"

start=$SECONDS
while [ "$(state)" != succeeded ]; do
    [ $((SECONDS - start)) -lt 300 ] || fail "the job does not end: $(state)"
    [ "$(state)" != failed ] || fail "the job failed"
    sleep 0.5
done
evogait fetch "$id" --out "$dir/fetched" --quiet > /dev/null
[ "$(digest "$dir/fetched")" = "$expected" ] || fail "the result differs from the undisturbed one"
wait "$watching" || fail "the watcher on the other host did not see the end: $(cat "$dir/watch.log")"
echo "partitions change no bit"
rm -rf "$dir"
