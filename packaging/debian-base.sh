# shellcheck shell=bash
# For scripts, to be sourced: a base system of Debian, as a folder.

# debian_base CACHE: prints the path of a minimal Debian in the folder CACHE, which is made where it is missing. It is
# not to be written to. Needs root, debootstrap and a mirror; fails without them and says why.
debian_base() {
    local base=$1/debian
    [ "$(id -u)" = 0 ] || { echo 'not root' >&2; return 1; }
    if [ ! -e "$base.complete" ]; then
        command -v debootstrap >/dev/null || { echo 'no debootstrap (apt-get install debootstrap)' >&2; return 1; }
        echo 'debootstrap: the base system' >&2
        rm -rf "$base"
        mkdir -p "$1"
        debootstrap --variant=minbase bookworm "$base" "${DEBIAN_MIRROR:-http://deb.debian.org/debian}" \
            >"$base.log" 2>&1 || { tail -5 "$base.log" >&2; echo 'debootstrap failed: no mirror?' >&2; return 1; }
        rm -rf "$base"/var/cache/apt/archives/*.deb "$base"/var/lib/apt/lists/* "$base.log"
        touch "$base.complete"
    fi
    echo "$base"
}
