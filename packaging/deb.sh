#!/usr/bin/env bash
# Makes the Debian package of a binary that is built, and prints the path of the package. What is in it says
# [package.metadata.deb] of server/Cargo.toml.
#
#   packaging/deb.sh BINARY [FOLDER]    FOLDER for the package: target/debian without it
#
# Needs cargo-deb and cargo-about (cargo install --locked, the latter with --features cli), and dpkg-dev with binutils,
# for the libraries that the binary depends on. cargo-about collects the licences of the crates in the binary, which
# takes a minute; NOTICES=FILE takes the text that it made before.
set -euo pipefail
cd "$(dirname "$0")/.."
[ $# = 1 ] || [ $# = 2 ] || { echo "usage: $0 BINARY [FOLDER]" >&2; exit 2; }
binary=$(realpath "$1")
out=$(realpath --canonicalize-missing "${2:-target/debian}")
needed=(cargo-deb dpkg-shlibdeps strip)
[ -n "${NOTICES:-}" ] || needed+=(cargo-about)
for program in "${needed[@]}"; do
    command -v "$program" >/dev/null || { echo "$0: there is no $program" >&2; exit 1; }
done
# The date of the package is that of the commit, so that two runs make the same bytes.
SOURCE_DATE_EPOCH=${SOURCE_DATE_EPOCH:-$(git log -1 --format=%ct 2>/dev/null || date +%s)}
export SOURCE_DATE_EPOCH

stage=target/package
rm -rf "$stage"
mkdir -p "$stage" "$out"
install --strip -m 0755 "$binary" "$stage/packstone"
"$binary" man --out "$stage/man"
"$binary" completions bash >"$stage/packstone.bash"
"$binary" completions zsh >"$stage/_packstone"
"$binary" completions fish >"$stage/packstone.fish"
if [ -n "${NOTICES:-}" ]; then
    cp "$NOTICES" "$stage/THIRD-PARTY"
else
    # All crates of Cargo.lock, which cargo-about reads without the network then.
    cargo fetch --locked --quiet
    cargo about generate --config packaging/about.toml --manifest-path server/Cargo.toml \
        --locked --offline --output-file "$stage/THIRD-PARTY" packaging/about.hbs
fi
version=$("$binary" --version | cut -d ' ' -f 2)
maintainer=$(sed -n 's/^maintainer = "\(.*\)"$/\1/p' server/Cargo.toml)
cat >"$stage/changelog" <<CHANGELOG
packstone ($version-1) stable; urgency=medium

  * Version $version. CHANGELOG.md of the sources lists what changed.

 -- $maintainer  $(LC_ALL=C date --utc --date="@$SOURCE_DATE_EPOCH" '+%a, %d %b %Y %H:%M:%S +0000')
CHANGELOG

# cargo-deb takes the version from Cargo.toml, and the binary says its own.
cargo deb --no-build --quiet --package packstone-server --output "$out" >"$stage/cargo-deb.out"
package=$(tail -1 "$stage/cargo-deb.out")
[ "$(dpkg-deb --field "$package" Version)" = "$version-1" ] || {
    echo "$0: the binary is of version $version, Cargo.toml of another" >&2
    exit 1
}
echo "$package"
