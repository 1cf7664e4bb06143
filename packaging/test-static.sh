#!/usr/bin/env bash
# Runs a static binary in a chroot that holds nothing else but /dev/{,u}random: it packs a job, serves, finds localhost,
# and packs a job for a client. With another binary, of the same version and commit, both must pack a job to the same
# bits, and a server of the other one must take the static one as a worker.
#
#   packaging/test-static.sh BINARY [OTHER]
#
# Needs curl, and root for the chroot: without it, says so and ends with 0.
set -euo pipefail
cd "$(dirname "$0")/.."
[ $# = 1 ] || [ $# = 2 ] || { echo "usage: $0 BINARY [OTHER]" >&2; exit 2; }
[ "$(id -u)" = 0 ] || { echo "SKIPPED $0: not root" >&2; exit 0; }

root=$(mktemp -d)
server=
cleanup() {
    [ -z "$server" ] || kill "$server" 2>/dev/null || true
    wait 2>/dev/null || true
    rm -rf "$root"
}
trap cleanup EXIT
fail() { echo "packaging/test-static.sh: $1" >&2; exit 1; }
inside() { chroot "$root" "$@"; }

readelf --dynamic "$1" | grep -q NEEDED && fail 'the binary needs shared libraries'
install -m 0755 "$1" "$root/packstone"
cp examples/a16.json "$root/job.json"
# Seeds that no request names are drawn from them.
mkdir "$root/dev"
mknod -m 0444 "$root/dev/random" c 1 8
mknod -m 0444 "$root/dev/urandom" c 1 9

echo 'chroot: a packing'
inside /packstone run /job.json --out /out --format csv,html
[ -s "$root/out/result.csv" ] && [ -s "$root/out/result.html" ] || fail 'there is no result'

echo 'chroot: the service'
# Names are looked up in /etc/hosts, which is the one file of the system that the program reads for it.
mkdir "$root/etc"
echo '127.0.0.1 localhost' >"$root/etc/hosts"
# Of the disk of a machine that tests, 64 MiB must stay free, not 1 GiB.
PACKSTONE_MIN_FREE_BYTES=67108864 chroot "$root" /packstone serve --data-dir /data --listen 127.0.0.1:0 \
    >"$root/serve.out" 2>"$root/serve.err" &
server=$!
url=$(timeout 60 tail --pid="$server" -n +1 -f "$root/serve.out" | grep -m 1 -o 'http://127.0.0.1:[0-9]*' || true)
[ -n "$url" ] || { cat "$root/serve.out" "$root/serve.err" >&2; fail 'the service does not start'; }
inside /packstone health "${url/127.0.0.1/localhost}"
answer=$(curl -fsS "$url/v1/jobs" -H 'content-type: application/json' -H 'prefer: wait=60' -d @examples/a16.json)
grep -q '"state": *"succeeded"' <<<"$answer" || fail "the job: $answer"
kill -TERM "$server"
wait "$server" || fail 'the service ends with an error'
server=

if [ $# = 2 ]; then
    echo 'a worker of a server of the other binary'
    "$2" run examples/a16.json --out "$root/other" --format csv
    PACKSTONE_MIN_FREE_BYTES=67108864 "$2" serve --data-dir "$root/shared" --listen 127.0.0.1:0 --workers 0 \
        >"$root/other.out" 2>"$root/other.err" &
    server=$!
    url=$(timeout 60 tail --pid="$server" -n +1 -f "$root/other.out" | grep -m 1 -o 'http://127.0.0.1:[0-9]*' || true)
    [ -n "$url" ] || { cat "$root/other.out" "$root/other.err" >&2; fail 'the other service does not start'; }
    cmp "$root/out/result.csv" "$root/other/result.csv" || fail 'the binaries pack other bits'
    "$1" worker --server "$url" --scratch "$root/scratch" --idle-exit-s 1 || fail 'it is refused as a worker'
    kill -TERM "$server"
    wait "$server" || fail 'the other service ends with an error'
    server=
fi
echo 'packaging/test-static.sh: the binary works without a system'
