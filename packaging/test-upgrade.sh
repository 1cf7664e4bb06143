#!/usr/bin/env bash
# Upgrades a server and its workers from one build to another while jobs wait and run, and says who is served and who is
# refused (docs/cluster.md, "Upgrades"). It fails where a job is lost or packed twice, or a result changes.
#
#   packaging/test-upgrade.sh OLD NEW    binaries of two commits
#
# Needs curl and jq.
set -euo pipefail
[ $# = 2 ] || { echo "usage: $0 OLD NEW" >&2; exit 2; }
old=$(realpath "$1") new=$(realpath "$2")
fail() { echo "packaging/test-upgrade.sh: $1" >&2; tail -n 20 "$work"/*.log >&2; exit 1; }
work=$(mktemp -d)
server='' worker=''
# shellcheck disable=SC2317 # called by the trap
end() {
    [ -z "$server$worker" ] || kill -KILL $server $worker 2>/dev/null || true
    rm -rf "$work"
}
trap end EXIT
port=$((20000 + RANDOM % 10000))
url=http://127.0.0.1:$port
[ "$("$old" --version)" != "$("$new" --version)" ] || fail 'both binaries are of one build'

serve() { # BINARY: starts a server without workers of its own
    "$1" serve --data-dir "$work/data" --listen "127.0.0.1:$port" --workers 0 --lease-s 4 >>"$work/server.log" 2>&1 &
    server=$!
    curl -fsS --retry 60 --retry-delay 1 --retry-connrefused -o "$work/ready" "$url/readyz"
}
stop() { # ends the server
    kill -TERM "$server"
    wait "$server" || fail "the server ended with code $?"
    server=''
}
work() { # BINARY SLOTS: starts a worker that ends when it has had no job for 2 s
    "$1" worker --server "$url" --slots "$2" --idle-exit-s 2 --scratch "$work/scratch" >>"$work/worker.log" 2>&1 &
    worker=$!
}
worked() { # CODE: waits for the end of the worker
    local code=0
    wait "$worker" || code=$?
    worker=''
    [ "$code" = "$1" ] || fail "the worker ended with code $code instead of $1"
}
submit() { # SEED EDGE: a job that grows spheres in a cube; prints its ID
    jq -n --argjson seed "$1" --argjson edge "$2" '{
        seed: $seed, specimen: {type: "box", size_mm: [$edge, $edge, $edge]}, distance: {type: "constant", gap_mm: 0.5},
        mix: {grading: {type: "standard", name: "A16"}, d_min_mm: 4, volume_fraction: 0.5}, method: {type: "edmd"}
    }' | curl -fsS "$url/v1/jobs" -H 'content-type: application/json' -d @- | jq -r .id
}
job() { curl -fsS "$url/v1/jobs/$1" | jq -r "$2"; } # ID FILTER
until_running() { # ID
    local state=queued
    while [ "$state" = queued ]; do sleep 0.2; state=$(job "$1" .state); done
    [ "$state" = running ] || fail "job $1 is $state"
}
ends() { # ID: waits for its success
    curl -fsS -H 'prefer: wait=120' -o "$work/ended" "$url/v1/jobs/$1"
    [ "$(job "$1" .state)" = succeeded ] || fail "job $1 is $(job "$1" .state)"
}
digest() { curl -fsS "$url/v1/jobs/$1/result?format=npy" | sha256sum; } # ID

echo 'old server, old worker: a job is packed'
serve "$old"
first=$(submit 1 40)
work "$old" 1
worked 0
ends "$first"
before=$(digest "$first")

echo 'old server, new worker: refused with code 8, and the job waits'
waiting=$(submit 2 40)
work "$new" 1
worked 8
[ "$(job "$waiting" .state)" = queued ] || fail 'the job does not wait'

echo 'new server, old worker with a job and a free slot: it delivers its job, and is refused with code 8'
held=$(submit 3 200)
work "$old" 2
until_running "$held"
stop
serve "$new"
worked 8
ends "$held"
echo "    attempt $(job "$held" .attempt), engine $(job "$held" '.engine | tojson')"
[ "$(job "$held" .attempt)" = 1 ] || fail 'the job was packed twice'

echo 'new server, new worker: what waits is packed, and results are as before'
last=$(submit 4 40)
work "$new" 1
ends "$last"
worked 0
[ "$(digest "$first")" = "$before" ] || fail 'a result has changed'
stop
"$new" check "$work/data" || fail 'files are not as they were recorded'

echo 'old server on the data directory of the new one'
code=0
timeout 20 "$old" serve --data-dir "$work/data" --listen "127.0.0.1:$port" >"$work/older.log" 2>&1 || code=$?
echo "    code $code (124: it is served): $(grep -v INFO "$work/older.log" | tail -n 1)"
