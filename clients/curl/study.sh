#!/usr/bin/env bash
# Submits a study of three volume fractions, two methods and five seeds, waits for it, writes its table and a plot, saves all
# packings, and reads one of them into arrays. Needs bash, curl 7.76 or later, and jq.
#
#   study.sh [DIRECTORY]                the folder of the files; the current one if absent
#   PACKSTONE_URL=http://lab:8080       the server; that of this machine if absent
#   PACKSTONE_API_KEY=packstone_...     the key, if the server requires one
set -euo pipefail

url=${PACKSTONE_URL:-http://127.0.0.1:8080}
out=${1:-.}

answer=$(mktemp)
trap 'rm -f "$answer"' EXIT

# Prints the answer of the server. On an error it prints the explanation of the server to standard error and fails.
api() {
    local fields=()
    if [ -n "${PACKSTONE_API_KEY:-}" ]; then
        fields=(--header "authorization: Bearer $PACKSTONE_API_KEY")
    fi
    # Seven attempts, with growing pauses or with those of the field Retry-After.
    if ! curl --silent --show-error --fail-with-body --retry 6 --retry-connrefused --output "$answer" "${fields[@]}" "$@"; then
        cat "$answer" >&2
        echo >&2
        return 1
    fi
    cat "$answer"
}

request='{
  "name": "A16 by two methods", "seed": 1,
  "template": {
    "specimen": {"type": "box", "size_mm": [60, 60, 60]},
    "mix": {"grading": {"type": "standard", "name": "A16"}, "d_min_mm": 4, "volume_fraction": 0.65},
    "distance": {"type": "constant", "gap_mm": 0.5},
    "method": {"type": "auto"}
  },
  "grid": {
    "/mix/volume_fraction": [0.55, 0.65, 0.75],
    "/method/type": ["rsa", "edmd"]
  },
  "replicates": 5
}'

# With this key a repeated submission is safe: the same key and body are the same study.
study=$(api "$url/v1/studies" --header 'content-type: application/json' \
    --header "idempotency-key: study.sh-$(date +%s)-$$" --data "$request")
path=/v1/studies/$(jq --raw-output .id <<<"$study")
echo "submitted as $path"

# The server holds each answer back until the study has ended, or for a minute.
while [ "$(jq --raw-output .finished_at <<<"$study")" = null ]; do
    study=$(api "$url$path" --header 'prefer: wait=60')
    jq --raw-output '"\(.counts.succeeded) succeeded, \(.counts.failed) failed, of \(.jobs)"' <<<"$study"
done

api "$url$path/table?format=csv" >"$out/table.csv"
api "$url$path/plots/success" >"$out/success.svg"
# The table for people.
jq --raw-output '.rows[] | "phi \(.["/mix/volume_fraction"])  \(.["/method/type"])\t\(.successes) of \(.runs)"' \
    <<<"$(api "$url$path/table?format=json")"

# All packings, named by their seed and method; the IDs and seeds of the jobs, oldest first.
jobs=$(api "$url$path/jobs?state=succeeded&sort=created&limit=100")
while read -r job seed point; do
    api "$url/v1/jobs/$job/result?format=csv" >"$out/packing-$point-$seed.csv"
done < <(jq --raw-output '.items[] | "\(.id) \(.seed) \(.point)"' <<<"$jobs")

# A cross-section of the first one. The server makes it within the answer, or says 202 while it makes it.
first=/v1/jobs/$(jq --raw-output '.items[0].id' <<<"$jobs")
api "$url$first/exports/slice?format=svg&axis=z" >"$out/slice.svg"

# The first packing, as four arrays of the same length, largest grain first.
api "$url$first/result?format=csv" >"$out/packing.csv"
x=() y=() z=() d=()
{
    read -r _ # x_mm,y_mm,z_mm,d_mm
    while IFS=, read -r x_mm y_mm z_mm d_mm; do
        x+=("$x_mm") y+=("$y_mm") z+=("$z_mm") d+=("$d_mm")
    done
} <"$out/packing.csv"
echo "${#d[@]} grains; the largest, of ${d[0]} mm, lies at (${x[0]}, ${y[0]}, ${z[0]}) mm"
