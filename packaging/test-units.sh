#!/usr/bin/env bash
# Runs the units of a Debian package by systemd, which systemd-nspawn boots in a Debian with a network of its own: the
# service with keys and without workers of its own, and a worker, which packs a job for it. Then it is upgraded.
#
#   packaging/test-units.sh PACKAGE    as packaging/deb.sh makes it
#
# Needs root, systemd-nspawn (apt-get install systemd-container), debootstrap and a Debian mirror; without them it says
# so and ends with 0. BASE_CACHE=DIR keeps the base system.
set -euo pipefail
cd "$(dirname "$0")/.."
source packaging/debian-base.sh
[ $# = 1 ] || { echo "usage: $0 PACKAGE" >&2; exit 2; }
package=$(realpath "$1")
fail() { echo "packaging/test-units.sh: $1" >&2; exit 1; }
skip() { echo "SKIPPED packaging/test-units.sh: $1" >&2; exit 0; }
command -v systemd-nspawn >/dev/null || skip 'no systemd-nspawn (apt-get install systemd-container)'

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cache=${BASE_CACHE:-$work/cache}
base=$(debian_base "$cache") || skip 'no base system'
root=$work/root
cp --archive "$base" "$root"
inside() { chroot "$root" env -i PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin "$@"; }

echo 'systemd in the base system'
cp --dereference /etc/resolv.conf "$root/etc/resolv.conf"
{ inside apt-get update -qq && inside env DEBIAN_FRONTEND=noninteractive apt-get install --yes -qq \
    --no-install-recommends systemd systemd-sysv dbus curl; } >"$work/apt.log" 2>&1 \
    || { tail -5 "$work/apt.log" >&2; skip 'systemd cannot be installed'; }

echo 'the package and its configuration'
cp "$package" "$root/packstone.deb"
inside dpkg --install /packstone.deb >"$work/dpkg.log"
etc=$root/etc/packstone
inside packstone key me --add-to /etc/packstone/keys.txt >"$work/me" 2>/dev/null
inside packstone key cluster --role worker --add-to /etc/packstone/keys.txt >"$work/cluster" 2>/dev/null
chmod 0644 "$etc/keys.txt"
install -m 0600 "$work/cluster" "$etc/worker.key"
printf '%s\n' PACKSTONE_API_KEYS_FILE=/etc/packstone/keys.txt PACKSTONE_WORKERS=0 >>"$etc/packstone.env"
sed -i 's|^PACKSTONE_SERVER=.*|PACKSTONE_SERVER=http://127.0.0.1:8080|' "$etc/packstone-worker.env"
inside systemctl enable --quiet packstone packstone-worker

# What the booted system does: it submits a job, writes down what it sees, and ends.
cat >"$root/probe.sh" <<PROBE
exec >/probe.out 2>&1
curl -fsS --retry 60 --retry-delay 1 --retry-connrefused -o /dev/null http://127.0.0.1:8080/readyz
curl -fsS http://127.0.0.1:8080/v1/jobs -H 'authorization: Bearer $(sed -n 1p "$work/me")' -H 'prefer: wait=60' \\
    -H 'content-type: application/json' -d @/usr/share/doc/packstone/examples/a16-distance.json -o /job.json
systemctl show --property=ActiveState,User,NRestarts packstone packstone-worker
systemctl show --property=MainPID packstone packstone-worker >/before
dpkg --install /packstone.deb </dev/null
systemctl show --property=MainPID packstone packstone-worker >/after
systemctl stop packstone-worker packstone
systemctl show --property=Id,Result packstone packstone-worker
journalctl --no-pager --unit=packstone --unit=packstone-worker
PROBE
cat >"$root/etc/systemd/system/probe.service" <<'UNIT'
[Unit]
After=packstone.service packstone-worker.service
[Service]
Type=oneshot
ExecStart=/bin/bash /probe.sh
ExecStopPost=systemctl poweroff --no-block
[Install]
WantedBy=multi-user.target
UNIT
inside systemctl enable --quiet probe

echo 'systemd: the service and a worker'
timeout 180 systemd-nspawn --directory="$root" --boot --register=no --keep-unit --private-network \
    --machine="packstone-$$" </dev/null >"$work/boot.log" 2>&1 || { tail -20 "$work/boot.log" >&2; fail 'the boot'; }
bad() { cat "$root/probe.out" >&2 || tail -20 "$work/boot.log" >&2; fail "$1"; }
[ -s "$root/job.json" ] || bad 'there is no answer'
grep -q '"state": *"succeeded"' "$root/job.json" || bad 'the job did not succeed'
grep -q '"worker": *"' "$root/job.json" || bad 'the job names no worker'
[ "$(grep -c '^ActiveState=active$' "$root/probe.out")" = 2 ] || bad 'a unit did not run'
[ "$(grep -c '^NRestarts=0$' "$root/probe.out")" = 2 ] || bad 'a unit was started again'
[ "$(grep -c '^Result=success$' "$root/probe.out")" = 2 ] || bad 'a unit ended with an error'
# The same package again, as an upgrade: running units are restarted, and the configuration is kept.
[ "$(grep -c '^MainPID=[1-9]' "$root/after")" = 2 ] || bad 'a unit does not run after an upgrade'
! grep MainPID "$root/before" | grep -qxFf - "$root/after" || bad 'an upgrade does not restart a unit'
grep -qx PACKSTONE_WORKERS=0 "$etc/packstone.env" || bad 'an upgrade takes the configuration'
[ "$(stat -c %u "$root/var/lib/private/packstone")" -ge 61184 ] || bad 'the state is not of a dynamic user'
echo 'packaging/test-units.sh: the units work'
