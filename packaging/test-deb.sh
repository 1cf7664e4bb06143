#!/usr/bin/env bash
# Makes the Debian package of a binary that is built, checks it, installs it into a chroot of Debian, runs the service
# there as its unit says, packs a job, and removes the package again.
#
#   packaging/test-deb.sh BINARY      or a folder with it, as target/release
#
# systemd does not run in the chroot (packaging/test-units.sh runs the units by systemd). The script takes the command,
# the file of variables and the variables from the installed unit, and does for the process what systemd would: a user
# without a name, who owns the state directory.
# Needs cargo-deb, dpkg-dev and curl; for the chroot root, debootstrap and a Debian mirror: without these it says so and
# ends with 0. BASE_CACHE=DIR keeps the base system. lintian and systemd-analyze judge the package where they are
# installed.
set -euo pipefail
cd "$(dirname "$0")/.."
source packaging/debian-base.sh
[ $# = 1 ] || { echo "usage: $0 BINARY | FOLDER" >&2; exit 2; }
binary=$1
[ ! -d "$binary" ] || binary=$binary/packstone

work=$(mktemp -d)
server=
cleanup() {
    [ -z "$server" ] || kill "$server" 2>/dev/null || true
    wait 2>/dev/null || true
    rm -rf "$work"
}
trap cleanup EXIT
fail() { echo "packaging/test-deb.sh: $1" >&2; exit 1; }

echo 'the package'
# The licences of the crates are not what is tested here.
echo 'a test' >"$work/notices"
package=$(NOTICES=${NOTICES:-$work/notices} packaging/deb.sh "$binary" "$work")
dpkg-deb --info "$package"
dpkg-deb --contents "$package" | awk '{ print $NF }' >"$work/files"
for file in usr/bin/packstone usr/lib/systemd/system/packstone{,-worker}.service etc/packstone/packstone{,-worker}.env \
    usr/share/man/man1/packstone{,-serve}.1.gz usr/share/bash-completion/completions/packstone \
    usr/share/zsh/vendor-completions/_packstone usr/share/fish/vendor_completions.d/packstone.fish \
    usr/share/doc/packstone/{README.md,copyright,LICENSE-MIT,LICENSE-APACHE,THIRD-PARTY}; do
    grep -qx "./$file" "$work/files" || fail "$file is not in the package"
done
conffiles=$(dpkg-deb --info "$package" conffiles | grep . | sort | tr '\n' ' ')
[ "$conffiles" = '/etc/packstone/packstone-worker.env /etc/packstone/packstone.env ' ] || fail "conffiles: $conffiles"
if command -v lintian >/dev/null; then
    # The environment files may hold the password of a database. The package is not made for Debian's archive.
    lintian --allow-root --fail-on error,warning \
        --suppress-tags non-standard-file-perm,initial-upload-closes-no-bugs "$package"
else
    echo 'no lintian: what it would find stays unknown' >&2
fi

base=$(debian_base "${BASE_CACHE:-$work/cache}") || { echo 'SKIPPED packaging/test-deb.sh: the chroot' >&2; exit 0; }
root=$work/root
cp --archive "$base" "$root"
inside() { chroot "$root" env -i PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin "$@"; }
# What is in the chroot but for the records of dpkg.
contents() { (cd "$root" && find . -path ./var/lib/dpkg -prune -o -path ./var/log -prune -o -print | sort); }
contents >"$work/before"

echo 'chroot: installation'
cp "$package" "$root/packstone.deb"
# Without the network: the base system has all that the package depends on.
inside dpkg --install /packstone.deb
rm "$root/packstone.deb"
inside packstone --version
unit=$root/usr/lib/systemd/system/packstone.service
enabled=$(find "$root/etc/systemd" -name 'packstone*' -print)
[ -z "$enabled" ] || fail "the installation enables $enabled"

if command -v systemd-analyze >/dev/null; then
    # The base system has no systemd, whose targets are missing.
    verified=$(systemd-analyze verify --man=no --root="$root" packstone.service packstone-worker.service 2>&1 || true)
    verified=$(grep -v 'Unit sysinit.target not found' <<<"$verified" || true)
    [ -z "$verified" ] || fail "the units: $verified"
fi

echo 'chroot: a job in the service of the unit'
# value KEY: what the unit says, a line for each line of the unit.
value() { sed -n "s/^$1=//p" "$unit"; }
read -ra command <<<"$(value ExecStart)"
state=/var/lib/$(value StateDirectory)
[ "$(value DynamicUser)" = yes ] || fail 'the unit does not have a user of its own'
# The first of the numbers that systemd gives to such users.
user=61184
install -d -m "$(value StateDirectoryMode)" -o "$user" -g "$user" "$root$state"
mapfile -t variables < <(value Environment; grep -v '^#' "$root$(value EnvironmentFile)")
# Not `inside`, whose process would be a shell that does not pass signals on. The port is any that is free. Of the disk
# of a machine that tests, 64 MiB must stay free, not 1 GiB.
chroot --userspec="$user:$user" "$root" env -i PATH=/usr/local/bin:/usr/bin "${variables[@]}" \
    PACKSTONE_LISTEN=127.0.0.1:0 PACKSTONE_MIN_FREE_BYTES=67108864 "${command[@]}" \
    >"$work/serve.out" 2>"$work/serve.err" &
server=$!
# The line that names the port; the end of the process ends the wait, too.
url=$(timeout 60 tail --pid="$server" -n +1 -f "$work/serve.out" | grep -m 1 -o 'http://127.0.0.1:[0-9]*' || true)
[ -n "$url" ] || { cat "$work/serve.out" "$work/serve.err" >&2; fail 'the service does not start'; }
answer=$(curl --fail-with-body -sS "$url/v1/jobs" -H 'content-type: application/json' -H 'prefer: wait=60' \
    -d @"$root/usr/share/doc/packstone/examples/a16-distance.json") ||
    { cat "$work/serve.err" >&2; fail "the service answers: $answer"; }
grep -q '"state": *"succeeded"' <<<"$answer" || { cat "$work/serve.err" >&2; fail "the job: $answer"; }
inside packstone health "$url"
kill "-$(value KillSignal)" "$server"
wait "$server" || fail 'the service ends with an error'
server=
[ -n "$(find "$root$state" -type f)" ] || fail "nothing is in $state"

echo 'chroot: removal'
echo '# changed by the administrator' >>"$root/etc/packstone/packstone.env"
inside dpkg --remove packstone
[ ! -e "$root/usr/bin/packstone" ] || fail 'the binary is still there'
grep -q administrator "$root/etc/packstone/packstone.env" || fail 'removal takes the configuration, too'
inside dpkg --purge packstone 2>&1 | tee "$work/purge.out"
grep -q "kept in $state" "$work/purge.out" || fail 'purging does not say that the jobs are kept'
[ -n "$(find "$root$state" -type f)" ] || fail 'purging took the jobs'
rm -r "${root:?}$state"
contents >"$work/after"
diff "$work/before" "$work/after" || fail 'the package leaves files behind'
echo 'packaging/test-deb.sh: the package works'
