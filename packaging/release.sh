#!/usr/bin/env bash
# Makes the files of a release, in a folder that is new: the Debian package, an archive with the static binary, the
# wheel for Python, the container image, the bill of materials (CycloneDX 1.5), and their checksums.
#
#   packaging/release.sh [FOLDER]    without it target/releases/VERSION
#   BINARY=FILE STATIC_BINARY=FILE packaging/release.sh    takes binaries that are built, as a trial
#
# The version is that of Cargo.toml. Needs maturin and ziglang (pip install maturin ziglang auditwheel), cargo-about,
# cargo-cyclonedx and cargo-deb (cargo install --locked), rustup and musl-gcc (Debian: musl-tools), and what
# packaging/deb.sh needs. The image needs docker or podman, and a registry with its base images.
set -euo pipefail
cd "$(dirname "$0")/.."
[ $# -le 1 ] || { echo "usage: $0 [FOLDER]" >&2; exit 2; }
fail() { echo "packaging/release.sh: $1" >&2; exit 1; }

version=$(cargo pkgid --package packstone-server | sed 's/.*[#@]//')
for file in CITATION.cff openapi.yaml; do
    stated=$(sed -n 's/^ *version: *//p' "$file" | head -1)
    [ "$stated" = "$version" ] || fail "$file states version $stated, Cargo.toml $version"
done
# A commit with a tag of a version is that version.
tag=$(git tag --points-at HEAD --list 'v*')
[ -z "$tag" ] || [ "$tag" = "v$version" ] || fail "the commit has the tag $tag, Cargo.toml states $version"
if [ -n "$tag" ]; then
    grep -q "^## .*$version" CHANGELOG.md || fail "CHANGELOG.md has no section of $version"
    git diff --quiet HEAD || fail 'there are changes that are not committed'
fi
out=${1:-target/releases/$version}
[ ! -e "$out" ] || fail "$out exists"
mkdir -p "$out"
out=$(realpath "$out")
SOURCE_DATE_EPOCH=$(git log -1 --format=%ct)
export SOURCE_DATE_EPOCH

# The profile and the features of the container image (docker/Dockerfile).
build=(--profile dist --locked --package packstone-server --bin packstone)
target=${CARGO_TARGET_DIR:-target}
host=$(rustc -vV | sed -n 's/^host: //p')

echo '=== the binary'
if [ -z "${BINARY:-}" ]; then
    cargo build "${build[@]}"
    BINARY=$target/dist/packstone
fi
[ "$("$BINARY" --version | cut -d ' ' -f 2)" = "$version" ] || fail "$BINARY is not of version $version"
"$BINARY" openapi | diff -q openapi.yaml - >/dev/null || fail "openapi.yaml is not that of $BINARY"
[ -n "$tag" ] || echo 'a trial: the commit has no tag of a version' >&2

echo '=== the Debian package'
packaging/deb.sh "$BINARY" "$out"

echo '=== the static binary'
if [ -z "${STATIC_BINARY:-}" ]; then
    # Linked to musl, but for the allocator (server/Cargo.toml).
    musl=$(uname -m)-unknown-linux-musl
    rustup target add "$musl"
    env "CC_${musl//-/_}=musl-gcc" cargo build "${build[@]}" --target "$musl"
    STATIC_BINARY=$target/$musl/dist/packstone
fi
packaging/test-static.sh "$STATIC_BINARY" target/package/packstone

echo '=== the archive'
# What deb.sh has put together, manual pages, completions and licences, with the static binary.
name=packstone-$version-$(uname -m)-linux
mkdir -p "target/package/$name"
cp -r target/package/{man,packstone.bash,_packstone,packstone.fish,THIRD-PARTY} "target/package/$name"
install --strip -m 0755 "$STATIC_BINARY" "target/package/$name/packstone"
cp LICENSE-MIT LICENSE-APACHE CHANGELOG.md packaging/packstone{,-worker}.{service,env} "target/package/$name"
tar --directory target/package --sort=name --owner=0 --group=0 --numeric-owner --mtime="@$SOURCE_DATE_EPOCH" \
    --create "$name" | gzip --no-name -9 >"$out/$name.tar.gz"

echo '=== the wheel'
grep -q "^version = \"$version\"$" python/Cargo.toml || fail "python/Cargo.toml is not of version $version"
# In the folder of the build of its own workspace, without debug symbols. The linker of Zig takes the symbols of an old
# C library, whatever the machine has: the wheel is for glibc 2.17 and later.
maturin build --quiet --release --locked --zig --compatibility manylinux2014 --manifest-path python/Cargo.toml \
    --out "$out"
auditwheel show "$out"/packstone-*.whl

echo '=== the container image'
image=packstone:$version
builder=
for program in docker podman; do
    # A client whose daemon does not run builds nothing.
    [ -n "$builder" ] || ! "$program" info >/dev/null 2>&1 || builder=$program
done
commit=$(git rev-parse --short=12 HEAD)
if [ -n "$builder" ]; then
    "$builder" build --file docker/Dockerfile --build-arg "COMMIT=$commit" --tag "$image" .
    "$builder" save "$image" | gzip --no-name -9 >"$out/packstone-$version-image.tar.gz"
    fem=packstone-fem:$version
    "$builder" build --file docker/Dockerfile.fem --build-arg "IMAGE=$image" --tag "$fem" docker
    "$builder" save "$fem" | gzip --no-name -9 >"$out/packstone-fem-$version-image.tar.gz"
else
    echo "no docker or podman that runs; $image is made by:" \
        "docker build -f docker/Dockerfile --build-arg COMMIT=$commit -t $image ." >&2
fi

echo '=== the bill of materials'
# cargo-cyclonedx writes beside the Cargo.toml of each crate of the workspace.
cargo cyclonedx --quiet --manifest-path server/Cargo.toml --format json --spec-version 1.5 \
    --no-build-deps --target "$host" --override-filename packstone-bill
# Its references have the folder of this build.
sed "s|file://$PWD/|file:///|g" server/packstone-bill.json >"$out/packstone-$version.cdx.json"
rm {server,engine,benches}/packstone-bill.json

echo '=== the checksums'
(cd "$out" && sha256sum -- * >SHA256SUMS && sha256sum --check --quiet SHA256SUMS)
ls -l "$out"
