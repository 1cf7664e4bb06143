#!/usr/bin/env bash
# Builds docker/Dockerfile for real and runs what comes out: Debian's buildah builds it without a daemon, on base images made
# by debootstrap; the binary of the image runs in a chroot of it, as the image's user, and packs a job.
#
#   docker/test.sh BINARY         the build stage takes this binary, so that only the image is tested (a minute)
#   docker/test.sh --from-source  the build stage compiles, with this machine's Rust toolchain and crates (many minutes)
#
# Needs root, buildah, debootstrap and a Debian mirror; without them it says so and ends with 0.
# BASE_CACHE=DIR keeps the base system, PROFILE=release builds faster than the default `dist`.
set -euo pipefail
cd "$(dirname "$0")/.."
source packaging/debian-base.sh

skip() {
    echo "SKIPPED docker/test.sh: $1" >&2
    exit 0
}
[ $# = 1 ] || { echo "usage: $0 BINARY | --from-source" >&2; exit 2; }
command -v buildah >/dev/null || skip 'no buildah (apt-get install buildah)'

work=$(mktemp -d)
cache=${BASE_CACHE:-$work/cache}
# Storage of its own: nothing of the machine's is touched. vfs needs no rights that a container has not.
export STORAGE_DRIVER=vfs BUILDAH_ISOLATION=chroot
buildah() { command buildah --root "$work/storage" --runroot "$work/run" "$@"; }
server=
cleanup() {
    [ -z "$server" ] || kill "$server" 2>/dev/null || true
    wait 2>/dev/null || true
    buildah rm --all >/dev/null 2>&1 || true
    rm -rf "$work"
}
trap cleanup EXIT

# image NAME FOLDER: an image of one layer with what the folder has.
image() {
    local container
    container=$(buildah from scratch)
    buildah copy -q "$container" "$2" / >/dev/null
    buildah config --env PATH=/usr/local/cargo/bin:/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin "$container"
    buildah commit -q "$container" "localhost/$1" >/dev/null
    buildah rm "$container" >/dev/null
}

base=$(debian_base "$cache") || skip 'no base system'
image packstone-runtime "$base"

# The build image: the base with what spares the build stage a registry of images, of crates, or the compilation.
container=$(buildah from localhost/packstone-runtime)
volumes=()
if [ "$1" = --from-source ]; then
    # The toolchain and the crates of this machine stand in for those of the image `rust`.
    cargo fetch --locked
    volumes=(--volume "$(rustc --print sysroot):/usr/local/cargo:ro" --volume "${CARGO_HOME:-$HOME/.cargo}/registry:/root/.cargo/registry")
    buildah config --env CARGO_NET_OFFLINE=true "$container"
else
    mkdir -p "$work/prebuilt/prebuilt"
    install -m 0755 "$1" "$work/prebuilt/prebuilt/packstone"
    buildah copy -q "$container" "$work/prebuilt" / >/dev/null
    # Never run: it tells the Dockerfile that there is a compiler.
    buildah run "$container" -- ln -s /bin/true /usr/bin/cc
fi
buildah commit -q "$container" localhost/packstone-build >/dev/null
buildah rm "$container" >/dev/null
build_image=localhost/packstone-build

echo 'buildah: docker/Dockerfile'
buildah build --isolation chroot --pull-never --format docker --layers=false \
    --ignorefile docker/Dockerfile.dockerignore --file docker/Dockerfile \
    --build-arg "BUILD_IMAGE=$build_image" --build-arg RUNTIME_IMAGE=localhost/packstone-runtime \
    --build-arg "COMMIT=$(git rev-parse --short=12 HEAD 2>/dev/null || echo unknown)" \
    --build-arg "PROFILE=${PROFILE:-dist}" "${volumes[@]}" --tag localhost/packstone .

# The settings of the image are those that the Dockerfile states.
buildah inspect --type image localhost/packstone >"$work/image.json"
python3 - "$work/image.json" <<'CHECK'
import json, sys
config = json.load(open(sys.argv[1]))["Docker"]["config"]
assert config["User"] == "10001:10001", config["User"]
assert config["Entrypoint"] == ["packstone"] and config["Cmd"] == ["serve"], config
assert "/data" in config["Volumes"] and "8080/tcp" in config["ExposedPorts"], config
assert config["Healthcheck"]["Test"] == ["CMD", "packstone", "health"], config
assert "PACKSTONE_DATA_DIR=/data" in config["Env"], config
CHECK

echo 'chroot: a job in the service of the image'
container=$(buildah from --pull-never localhost/packstone)
root=$(buildah mount "$container")
[ "$(stat -c %u:%g "$root/data")" = 10001:10001 ]
as_user() { chroot --userspec=10001:10001 "$root" env -i PATH=/usr/local/bin "$@"; }
as_user packstone --version
# Without the function, whose process would be a shell that does not pass signals on. Of the disk of a machine that
# tests, 64 MiB must stay free, not 1 GiB.
chroot --userspec=10001:10001 "$root" env -i PATH=/usr/local/bin PACKSTONE_LISTEN=127.0.0.1:0 PACKSTONE_DATA_DIR=/data \
    PACKSTONE_MIN_FREE_BYTES=67108864 packstone serve >"$work/serve.out" 2>"$work/serve.err" &
server=$!
# The line that names the port; the end of the process ends the wait, too.
url=$(timeout 60 tail --pid="$server" -n +1 -f "$work/serve.out" | sed -n '/listening on/{s/.*listening on //p;q}' || true)
[ -n "$url" ] || { cat "$work/serve.err" >&2; exit 1; }
answer=$(curl --fail-with-body -sS "$url/v1/jobs" -H 'content-type: application/json' -H 'prefer: wait=60' \
    -d @examples/a16-distance.json) || { echo "the service answers: $answer" >&2; cat "$work/serve.err" >&2; exit 1; }
state=$(python3 -c 'import json, sys; print(json.load(sys.stdin)["state"])' <<<"$answer")
[ "$state" = succeeded ] || { echo "the job is $state" >&2; cat "$work/serve.err" >&2; exit 1; }
if as_user packstone health --help >/dev/null 2>&1; then
    as_user packstone health "$url"
fi
kill -TERM "$server"
wait "$server"
server=
[ -n "$(find "$root/data" -type f)" ]
buildah umount "$container" >/dev/null
echo 'docker/test.sh: the image works'
