#!/usr/bin/env bash
# Builds docker/Dockerfile and docker/Dockerfile.fem for real and runs what comes out: Debian's buildah builds them
# without a daemon, on base images made by debootstrap. The binary of the first image runs in a chroot of it, as the
# image's user, and packs a job; that of the second makes tetrahedra with its Gmsh, whose volume is compared with the
# specimen's.
#
#   docker/test.sh BINARY         the build stage takes this binary, so that only the image is tested (a minute)
#   docker/test.sh --from-source  the build stage compiles, with this machine's Rust toolchain and crates (many minutes)
#
# Needs root, buildah, debootstrap and a Debian mirror; without them it says so and ends with 0.
# BASE_CACHE=DIR keeps the base system and the packages of Gmsh, PROFILE=release builds faster than the default `dist`.
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
    local path=/usr/local/cargo/bin:/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin
    buildah config --env "PATH=$path" "$container"
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
    registry=${CARGO_HOME:-$HOME/.cargo}/registry
    volumes=(--volume "$(rustc --print sysroot):/usr/local/cargo:ro" --volume "$registry:/root/.cargo/registry")
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
chroot --userspec=10001:10001 "$root" env -i PATH=/usr/local/bin PACKSTONE_LISTEN=127.0.0.1:0 \
    PACKSTONE_DATA_DIR=/data PACKSTONE_MIN_FREE_BYTES=67108864 packstone serve >"$work/serve.out" 2>"$work/serve.err" &
server=$!
# The line that names the port; the end of the process ends the wait, too.
url=$(timeout 60 tail --pid="$server" -n +1 -f "$work/serve.out" \
    | sed -n '/listening on/{s/.*listening on //p;q}' || true)
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
buildah rm "$container" >/dev/null
echo 'docker/test.sh: the image works'

curl -fsSI -o "$work/mirror" "${DEBIAN_MIRROR:-http://deb.debian.org/debian}/dists/bookworm/InRelease" \
    || skip 'no Debian mirror for the packages of Gmsh: docker/Dockerfile.fem was not built'
echo 'buildah: docker/Dockerfile.fem'
# The packages lie beside the base system between runs, and none in the image, as docker-clean of Debian's images has
# it.
mkdir -p "$cache/packages/partial"
buildah build --isolation chroot --pull-never --format docker --layers=false \
    --volume "$(realpath "$cache/packages"):/var/cache/apt/archives" --file docker/Dockerfile.fem \
    --build-arg IMAGE=localhost/packstone --tag localhost/packstone-fem docker

echo 'buildah run: tetrahedra by the Gmsh of the image'
mkdir "$work/fem"
cat >"$work/fem/job.json" <<'JOB'
{"seed": 3, "specimen": {"type": "box", "size_mm": [24, 20, 18]},
 "mix": {"grading": {"type": "fuller", "d_max_mm": 8, "exponent": 0.5}, "d_min_mm": 4, "volume_fraction": 0.5},
 "distance": {"type": "constant", "gap_mm": 0.5}}
JOB
chown -R 10001:10001 "$work/fem"
container=$(buildah from --pull-never localhost/packstone-fem)
# With the user and the variables of the image.
buildah run --volume "$work/fem:/fem" --workingdir /fem "$container" -- \
    packstone run job.json --out out --export mesh:elements=tetrahedra,format=inp,segments=8
[ "$(stat -c %u:%g "$work/fem/out/result.json")" = 10001:10001 ]
python3 - "$work"/fem/out/result.tetrahedra.*inp <<'CHECK'
import json, sys

nodes, elements, block = {}, [], ""
for line in open(sys.argv[1]):
    if line.startswith("*"):
        block = line.upper()
    elif block.startswith("*NODE\n"):
        number, *point = line.split(",")
        nodes[int(number)] = [float(x) for x in point]
    elif block.startswith("*ELEMENT, TYPE=C3D4"):
        elements.append([int(number) for number in line.split(",")][1:])


def volume(element):
    a, b, c, d = (nodes[number] for number in element)
    (x, y, z), (p, q, r), (u, v, w) = ([m - n for m, n in zip(corner, a)] for corner in (b, c, d))
    return (x * (q * w - r * v) + y * (r * u - p * w) + z * (p * v - q * u)) / 6


volumes = [volume(element) for element in elements]
report = json.load(open(sys.argv[1] + ".report.json"))
found = report["tetrahedra"]
assert found["mesher"].startswith("Gmsh 4."), found
assert len(elements) == found["elements"] > 1000, (len(elements), found)
assert min(volumes) > 0 and abs(sum(volumes) / (24 * 20 * 18) - 1) < 1e-9, (min(volumes), sum(volumes))
print(f"{len(elements)} tetrahedra by {found['mesher']} fill the box")
CHECK
buildah rm "$container" >/dev/null
echo 'docker/test.sh: the image -fem works'
