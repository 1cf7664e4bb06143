/** A request as a script for PowerShell and for MATLAB, which follow the job to its end. */
import { service } from "./address.js";
import { json } from "./code.js";

/** @param {any} request */
const pathOf = (request) => ("template" in request ? "/v1/studies" : "/v1/jobs");

/**
 * A result as a file; of a study its table.
 * @param {any} request
 */
const fileOf = (request) =>
  "template" in request ? ["table?format=csv", "study.csv"] : ["result?format=vtp", "packing.vtp"];

/** @param {any} request @param {boolean} withKey */
export function powershell(request, withKey) {
  const [result, file] = fileOf(request);
  const headers = withKey
    ? `@{ Authorization = "Bearer $env:PACKSTONE_API_KEY"; Prefer = "wait=60" }`
    : `@{ Prefer = "wait=60" }`;
  // A text between quotes and at signs ends at a line that begins with a quote, which JSON has none of.
  return `$jobs = "${service()}${pathOf(request)}"
$headers = ${headers}
$request = @'
${json(request)}
'@
$type = "application/json; charset=utf-8"
$job = Invoke-RestMethod $jobs -Method Post -Headers $headers -ContentType $type -Body $request
while (-not $job.finished_at) { $job = Invoke-RestMethod "$jobs/$($job.id)" -Headers $headers }
$job
Invoke-WebRequest "$jobs/$($job.id)/${result}" -Headers $headers -OutFile ${file}
`;
}

/** @param {any} request @param {boolean} withKey */
export function matlab(request, withKey) {
  const [result, file] = fileOf(request);
  const lines = json(request)
    .split("\n")
    .map((line) => `    "${line.replaceAll('"', '""')}"`)
    .join("\n");
  const key = withKey ? `'Authorization', ['Bearer ' getenv('PACKSTONE_API_KEY')]; ` : "";
  return `jobs = '${service()}${pathOf(request)}';
options = weboptions('MediaType', 'application/json', 'ContentType', 'json', 'Timeout', 90, ...
    'HeaderFields', {'Accept', '*/*'; ${key}'Prefer', 'wait=60'});
request = join([
${lines}
], newline);
job = webwrite(jobs, char(request), options);
while isempty(job.finished_at)
    job = webread([jobs '/' job.id], options);
end
disp(job.state)
websave('${file}', [jobs '/' job.id '/${result}'], options);
`;
}
