/** A request as text: JSON, a command with curl, a script with Python. */
import { service } from "./address.js";

/** @param {string} words */
const shellQuoted = (words) => `'${words.replaceAll("'", "'\\''")}'`;

/** @param {any} request */
const isStudy = (request) => "template" in request;

/** JSON on one line. @param {any} value @returns {string} */
function flat(value) {
  if (Array.isArray(value)) return `[${value.map(flat).join(", ")}]`;
  if (typeof value !== "object" || value === null) return JSON.stringify(value) ?? "null";
  return `{${Object.entries(value)
    .map(([name, one]) => `${JSON.stringify(name)}: ${flat(one)}`)
    .join(", ")}}`;
}

/** JSON with short arrays and objects on one line. @param {any} value @param {string} [indent] @returns {string} */
export function json(value, indent = "") {
  const line = flat(value);
  if (typeof value !== "object" || value === null || (indent && line.length + indent.length <= 88)) return line;
  const inner = `${indent}  `;
  const parts = Array.isArray(value)
    ? value.map((one) => inner + json(one, inner))
    : Object.entries(value).map(([name, one]) => `${inner}${JSON.stringify(name)}: ${json(one, inner)}`);
  const [open, close] = Array.isArray(value) ? "[]" : "{}";
  return parts.length ? `${open}\n${parts.join(",\n")}\n${indent}${close}` : `${open}${close}`;
}

/** @param {any} request @param {boolean} withKey */
export function curl(request, withKey) {
  const path = isStudy(request) ? "/v1/studies" : "/v1/jobs";
  const key = withKey ? '-H "Authorization: Bearer $PACKSTONE_API_KEY" ' : "";
  const type = "-H 'Content-Type: application/json'";
  return `curl -sS --fail-with-body ${key}${type} \\\n  ${service()}${path} -d ${shellQuoted(json(request))}\n`;
}

/** The literal of Python that stands for a JSON document. @param {any} request */
const literal = (request) =>
  json(request).replace(/"(?:[^"\\]|\\.)*"|\b(true|false|null)\b/g, (all, word) =>
    word ? (/** @type {Record<string, string>} */ ({ true: "True", false: "False", null: "None" })[word] ?? all) : all,
  );

/** @param {any} request @param {boolean} withKey */
export function python(request, withKey) {
  const client = `# pip install ./python${withKey ? "; the key is read from PACKSTONE_API_KEY" : ""}
import packstone

client = packstone.Client(${JSON.stringify(service())})
`;
  if (isStudy(request)) {
    return `${client}study = client.study(${literal(request)})
study.wait(progress=True)
for row in study.table():
    print(row)
`;
  }
  return `${client}job = client.submit(${literal(request)})
job.wait(progress=True)
job.result().save("packing.vtp")
`;
}
