#!/usr/bin/env bash
# Makes the files of a release, in a folder that is new: the Debian package, an archive with the binary, the bill of
# materials (CycloneDX 1.5), and their checksums.
#
#   packaging/release.sh [FOLDER]    without it target/releases/VERSION
#   BINARY=FILE packaging/release.sh    takes a binary that is built, as a trial
#
# The version is that of Cargo.toml. Needs cargo-about, cargo-cyclonedx and cargo-deb (cargo install --locked), and what
# packaging/deb.sh needs. The container image is made by docker/Dockerfile.
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

echo '=== the binary'
if [ -z "${BINARY:-}" ]; then
    # The profile and the features of the container image (docker/Dockerfile).
    cargo build --profile dist --features postgres,s3 --locked --package packstone-server --bin packstone
    BINARY=${CARGO_TARGET_DIR:-target}/dist/packstone
fi
[ "$("$BINARY" --version | cut -d ' ' -f 2)" = "$version" ] || fail "$BINARY is not of version $version"
"$BINARY" openapi | diff -q openapi.yaml - >/dev/null || fail "openapi.yaml is not that of $BINARY"
[ -n "$tag" ] || echo 'a trial: the commit has no tag of a version' >&2

echo '=== the Debian package'
packaging/deb.sh "$BINARY" "$out"

echo '=== the archive'
# What deb.sh has put together: binary, manual pages, completions, licences.
name=packstone-$version-$(uname -m)-linux
mkdir -p "target/package/$name"
cp -r target/package/{packstone,man,packstone.bash,_packstone,packstone.fish,THIRD-PARTY} "target/package/$name"
cp LICENSE-MIT LICENSE-APACHE CHANGELOG.md packaging/packstone{,-worker}.{service,env} "target/package/$name"
tar --directory target/package --sort=name --owner=0 --group=0 --numeric-owner --mtime="@$SOURCE_DATE_EPOCH" \
    --create "$name" | gzip --no-name -9 >"$out/$name.tar.gz"

# === The wheel: `maturin build --release --locked --out "$out" --manifest-path python/Cargo.toml` goes here. ===

echo '=== the bill of materials'
# cargo-cyclonedx writes beside the Cargo.toml of each crate of the workspace.
cargo cyclonedx --quiet --manifest-path server/Cargo.toml --format json --spec-version 1.5 --features postgres,s3 \
    --no-build-deps --target "$(rustc -vV | sed -n 's/^host: //p')" --override-filename packstone-bill
mv server/packstone-bill.json "$out/packstone-$version.cdx.json"
rm engine/packstone-bill.json

echo '=== the checksums'
(cd "$out" && sha256sum -- * >SHA256SUMS && sha256sum --check --quiet SHA256SUMS)
ls -l "$out"
