#!/usr/bin/env bash
# Workers on a real Slurm (slurmctld, slurmd and munge from Debian's packages, on this machine), as in docs/deploy.md,
# by a user without root. The job takes longer than a worker's wall time, so that workers drain, queue again, and are
# cancelled in the end; Slurm also kills one. The result must have the bits of `evogait run`, and no attempt may be
# charged.
#
#   tests/slurm.sh
#
# Needs root, and a development build (it is made) with faults on demand: slow workers make the job last without using a
# core. Installs slurmctld, slurmd and munge if they are missing; starts them with files of its own and stops them.
# Takes about 3 minutes, hardly more on a busy machine.
set -euo pipefail
cd "$(dirname "$0")/.."

step() { printf '\n-- %s (%s)\n' "$1" "$(date -u +%H:%M:%S)"; }
fail() { reason=$*; exit 1; }
reason=
trap 'reason="line $LINENO: $BASH_COMMAND"' ERR
trap '[ -z "$reason" ] || echo "slurm.sh: $reason" >&2' EXIT
[ "$(id -u)" = 0 ] || fail "it starts daemons: run it as root"

if ! command -v slurmctld slurmd munged sbatch > /dev/null; then
    step "Slurm from Debian's packages"
    apt-get update -qq
    DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends slurmctld slurmd slurm-client munge > /dev/null
fi

step "binaries"
cargo build --locked --quiet
binaries=target/debug

work=$(mktemp -d)
daemons=() follower=
clean_up() {
    status=$?
    trap - EXIT INT TERM
    if [ "$status" != 0 ]; then
        tail -n 30 "$work"/ctld.log "$work"/slurmd.log "$home"/evogait/*.log "$home"/clone/*.log 2> /dev/null || true
        squeue 2> /dev/null || true
        [ ! -e "$work/user.log" ] || cat "$work/user.log"
        echo "slurm.sh: ${reason:-ended with $status}" >&2
    fi
    # The user's processes first, then what Slurm runs for him, then Slurm.
    [ -z "$follower" ] || kill -- "-$follower" 2> /dev/null || true
    if [ "${#daemons[@]}" -gt 0 ]; then
        timeout 5 scancel --user="$user" || true
        for _ in $(seq 40); do
            [ -n "$(timeout 5 squeue --noheader 2> /dev/null)" ] || break
            sleep 0.5
        done
        kill "${daemons[@]}" 2> /dev/null || true
        wait "${daemons[@]}" 2> /dev/null || true
    fi
    [ ! -e "$work/munge/pid" ] || kill "$(cat "$work/munge/pid")" 2> /dev/null || true
    rm -rf "$work"
    exit "$status"
}
trap clean_up EXIT
trap 'exit 130' INT TERM

# A user without root, with a home on a file system that all nodes share.
user=games
home=$work/shared
mkdir -p "$home"/clone "$work"/munge "$work"/state "$work"/spool
chmod 755 "$work" "$work/munge"

step "Slurm: one node, four cores, wall times in minutes"
head -c 32 /dev/urandom > "$work/munge/key"
chmod 400 "$work/munge/key"
chown -R munge "$work/munge"
setpriv --reuid munge --regid munge --clear-groups munged --key-file "$work/munge/key" --socket "$work/munge/socket" \
    --pid-file "$work/munge/pid" --log-file "$work/munge/log" --seed-file "$work/munge/seed"
# Below the range of ports for outgoing connections.
port=$((10000 + RANDOM % 9000))
cat > "$work/slurm.conf" <<CONF
ClusterName=evogait
SlurmctldHost=localhost
SlurmctldPort=$port
SlurmdPort=$((port + 1))
SlurmUser=root
AuthType=auth/munge
CryptoType=crypto/munge
# What is requeued waits until its credential has expired, 2 minutes by default.
AuthInfo=socket=$work/munge/socket,cred_expire=5
StateSaveLocation=$work/state
SlurmdSpoolDir=$work/spool
SlurmctldPidFile=$work/ctld.pid
SlurmdPidFile=$work/slurmd.pid
SlurmctldLogFile=$work/ctld.log
SlurmdLogFile=$work/slurmd.log
ProctrackType=proctrack/pgid
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
SchedulerParameters=bf_interval=2,sched_interval=2,batch_sched_delay=1
SlurmdParameters=config_overrides
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
ReturnToService=2
KillWait=10
MinJobAge=600
NodeName=localhost NodeAddr=127.0.0.1 CPUs=4 State=UNKNOWN
PartitionName=all Nodes=ALL Default=YES MaxTime=10 State=UP
CONF
export SLURM_CONF=$work/slurm.conf
slurmctld -D > "$work/ctld.out" 2>&1 & daemons+=($!)
slurmd -D -N localhost > "$work/slurmd.out" 2>&1 & daemons+=($!)
deadline=$((SECONDS + 30))
until [ "$(sinfo --noheader --format=%T 2> /dev/null)" = idle ]; do
    (( SECONDS < deadline )) || { cat "$work"/*.out; fail "Slurm does not come up"; }
    sleep 0.5
done

# The clone of that user, with what the page takes from it.
mkdir -p "$home/clone/target/release" "$home/clone/deploy"
cp "$binaries"/{coordinator,worker,evogait} "$home/clone/target/release/"
cp -r deploy/slurm "$home/clone/deploy/"
cp -r docs tests "$home/clone/"
cat > "$home/as-user.sh" <<'USER'
# What the user does. The coordinator's port is this test's own; the job takes longer than a worker's minute.
set -euo pipefail
cd ~/clone
work=$HOME
. tests/page.sh
# What runs is given back at once: all of it would be finished within the page's grace time.
export EVOGAIT_GRACE=0
adapt() { sed "s/7077/$PORT/g; s/7078/$((PORT + 1))/g; s|/var/tmp/evogait-|$HOME/evogait-|; s/submit quadropod-empty\$/submit long.toml/"; }
follow slurm-coordinator
coordinator=$!
trap 'kill $coordinator' EXIT
# Two workers of a slot take four of 8 candidates each, 0.3 s a candidate: a minute and three quarters, so that they reach the
# end of their minute.
sed 's/^generations = .*/generations = 85/; s/^name = .*/name = "long"/' <(evogait scenarios show quadropod-quick) > long.toml
export EVOGAIT_COORDINATOR=https://localhost:$PORT EVOGAIT_CA=~/evogait/certs/ca.pem EVOGAIT_TOKEN_FILE=~/evogait/certs/client.token
until evogait health --quiet 2> /dev/null; do sleep 0.2; done
(export EVOGAIT_FAULT=slow@ms=300; follow slurm-workers) &
scaler=$!
wait "$scaler"
job=$(evogait list --json | python3 -c 'import json,sys; print(json.load(sys.stdin)[0]["id"])')
evogait show "$job"
evogait fetch "$job" --out result --json --quiet > result.json
curl -sS "http://127.0.0.1:$((PORT + 1))/metrics" > metrics
USER
export PORT=$((port + 2))
as_user() { exec setsid --wait setpriv --reuid "$user" --regid "$user" --clear-groups env HOME="$home" USER="$user" bash "$@"; }
chown -R "$user" "$home"

step "the page, by $user: coordinator, a job, workers that come and go"
as_user "$home/as-user.sh" > "$work/user.log" 2>&1 &
follower=$!
# Slurm takes running workers away, as a preemption does, until one had something to give back: between two generations it has not.
metric() { curl -sS "http://127.0.0.1:$((PORT + 1))/metrics" | sed -n "s/^evogait_$1 //p"; }
for _ in 1 2 3 4 5; do
    deadline=$((SECONDS + 60))
    until victim=$(squeue --noheader --states=running --format=%i | head -n 1) && [ -n "$victim" ]; do
        (( SECONDS < deadline )) || fail "no worker ever ran"
        sleep 1
    done
    sleep 5
    scontrol requeue "$victim" || continue # its time was just up
    sleep 2
    [ "$(metric 'leases_ended_total{why="drained"}')" = 0 ] || break
done
wait "$follower" || fail "the page can't be followed"
cat "$work/user.log"

step "what came of it"
digest() { python3 -c 'import json,sys; print(json.load(open(sys.argv[1]))["result_digest"])' "$1"; }
"$binaries/evogait" run "$home/clone/long.toml" --out "$work/here" --workers "$(nproc)" --json --quiet > "$work/here.json"
[ "$(digest "$home/clone/result.json")" = "$(digest "$work/here.json")" ] || fail "another digest than on this machine"
echo "   digest $(digest "$work/here.json"), as on this machine"
requeues=$(scontrol show job | grep -o 'Restarts=[0-9]*' | cut -d= -f2 | paste -sd+ -)
requeues=$((requeues))
(( requeues >= 2 )) || fail "no worker came back after its time was up ($requeues requeues)"
echo "   $requeues times a worker was queued again"
metric() { sed -n "s/^evogait_$1 //p" "$home/clone/metrics"; } # as the job ended
drains=$(cat "$home"/clone/evogait-*.log | grep -c "draining reason=\"its time is nearly up\"" || true)
(( drains >= 2 )) || fail "$drains workers drained before their time was up"
drained=$(metric 'leases_ended_total{why="drained"}')
(( drained >= 1 )) || fail "no worker gave anything back as it drained"
[ "$(metric attempts_total)" = 0 ] || fail "attempts were charged: $(metric attempts_total)"
echo "   $drains drains before the wall time was up, $drained assignments given back," \
    "$(metric 'leases_ended_total{why="lost"}') lost, 0 attempts charged"
deadline=$((SECONDS + 30))
until [ -z "$(squeue --noheader)" ]; do
    (( SECONDS < deadline )) || fail "there are workers left"
    sleep 1
done
