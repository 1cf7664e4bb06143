"""Checks what an operator installs: the manifests below docker/kubernetes and the systemd units in packaging.

    python manifests.py [--binary target/release/packstone]

Builds each kustomization, compares it with what `kustomize` or `kubectl kustomize` builds where one of them is found,
validates each object against the published schemas of the oldest and the newest Kubernetes, and checks what no schema
knows: that names and labels refer to each other, that containers have the rights of docker/Dockerfile and no more, and,
with --binary, that options and variables are those of the command. systemd-analyze verifies the units where it is found.
"""

import argparse
import configparser
import functools
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import jsonschema
import kubernetes_validate
import yaml

ROOT = Path(__file__).resolve().parents[2]
KUBERNETES = ROOT / "docker" / "kubernetes"
PACKAGING = ROOT / "packaging"
# The oldest release with all fields that are used, and the newest whose schemas the package has.
RELEASES = ["1.27", kubernetes_validate.latest_version()]
# Forecast seconds that one slot is to take on: docs/operation.md.
SECONDS_PER_SLOT = 600
# Ratings of `systemd-analyze security` go from 0 (all is forbidden) to 100.
MOST_EXPOSED = 15

STRINGS = {"type": "object", "additionalProperties": {"type": "string"}}


def fields(required, **optional):
    """A schema of an object with these fields and no others."""
    return {"type": "object", "properties": {**required, **optional}, "required": list(required),
            "additionalProperties": False}


TEXT, COUNT = {"type": "string"}, {"type": "integer", "minimum": 0}
# Of custom resources there are no schemas in the package. These have the fields that the manifests use, as documented
# at https://keda.sh/docs/latest/reference/scaledobject-spec and
# https://prometheus-operator.dev/docs/api-reference/api.
CUSTOM = {
    ("keda.sh/v1alpha1", "ScaledObject"): fields(
        {"scaleTargetRef": fields({"name": TEXT}, kind=TEXT, apiVersion=TEXT),
         "triggers": {"type": "array", "minItems": 1, "items": fields({
             "type": {"const": "prometheus"},
             # Values of all metadata are strings: a number without quotes is refused by the cluster.
             "metadata": fields({"serverAddress": TEXT, "query": TEXT, "threshold": TEXT}, activationThreshold=TEXT,
                                ignoreNullValues={"enum": ["true", "false"]}),
         })}},
        minReplicaCount=COUNT, maxReplicaCount=COUNT, pollingInterval=COUNT, cooldownPeriod=COUNT,
        advanced=fields({"horizontalPodAutoscalerConfig": fields({"behavior": fields({}, scaleDown=fields(
            {"stabilizationWindowSeconds": {"type": "integer", "minimum": 0, "maximum": 3600}}))})}),
    ),
    ("monitoring.coreos.com/v1", "ServiceMonitor"): fields({
        "selector": fields({"matchLabels": STRINGS}),
        "endpoints": {"type": "array", "minItems": 1, "items": fields(
            {"port": TEXT, "path": TEXT}, interval={"type": "string", "pattern": "^[0-9]+s$"},
            authorization=fields({"type": TEXT, "credentials": fields({"name": TEXT, "key": TEXT})}))},
    }),
}

failures = []


def check(holds, what):
    """Notes what does not hold; all of it is printed at the end."""
    if not holds:
        failures.append(what)


def documents(path):
    return [document for document in yaml.safe_load_all(path.read_text()) if document is not None]


def name_of(manifest):
    return f"{manifest['kind']}/{manifest['metadata']['name']}"


def build(folder, used):
    """The objects of a kustomization, as far as its fields are those used here; `used` gets the files that it reads."""
    path = folder / "kustomization.yaml"
    used.add(path)
    (kustomization,) = documents(path)
    known = {"apiVersion", "kind", "labels", "images", "resources", "patches"}
    assert kustomization.keys() <= known, f"{path}: {kustomization.keys() - known} is not known to this script"
    manifests = []
    for entry in kustomization["resources"]:
        target = (folder / entry).resolve()
        if target.is_dir():
            manifests += build(target, used)
        else:
            used.add(target)
            manifests += documents(target)
    for labels in kustomization.get("labels", []):
        assert labels.keys() == {"pairs"}, f"{path}: labels with other fields than pairs"
        for manifest in manifests:
            manifest["metadata"].setdefault("labels", {}).update(labels["pairs"])
    for image in kustomization.get("images", []):
        for manifest in manifests:
            for container in containers_of(manifest):
                if container["image"] == image["name"]:
                    container["image"] = f"{image.get('newName', image['name'])}:{image['newTag']}"
    for patch in kustomization.get("patches", []):
        matching = [manifest for manifest in manifests if all(
            {"kind": manifest["kind"], "name": manifest["metadata"]["name"]}[key] == value
            for key, value in patch["target"].items())]
        check(matching, f"{path}: the patch of {patch['target']} meets no object")
        for step in yaml.safe_load(patch["patch"]):
            assert step["op"] == "remove", f"{path}: the operation {step['op']} is not known to this script"
            *parents, last = step["path"].strip("/").split("/")
            for manifest in matching:
                for parent in parents:
                    manifest = manifest[parent]
                del manifest[last]
    return manifests


def containers_of(manifest):
    return manifest.get("spec", {}).get("template", {}).get("spec", {}).get("containers", [])


def compare_with_kustomize(folder, manifests):
    """The same by the tool itself."""
    tool = shutil.which("kustomize")
    command = [tool, "build"] if tool else [shutil.which("kubectl"), "kustomize"]
    if command[0] is None:
        print("manifests.py: neither kustomize nor kubectl was found; only this script has built the kustomizations")
        return
    built = subprocess.run([*command, folder], capture_output=True, text=True, check=False)
    if built.returncode != 0:
        failures.append(f"{folder}: {' '.join(command)}: {built.stderr.strip()}")
        return
    theirs = {name_of(manifest): manifest for manifest in yaml.safe_load_all(built.stdout)}
    ours = {name_of(manifest): manifest for manifest in manifests}
    check(theirs.keys() == ours.keys(), f"{folder}: kustomize builds {sorted(theirs)}, this script {sorted(ours)}")
    for name in theirs.keys() & ours.keys():
        check(theirs[name] == ours[name], f"{folder}: kustomize builds {name} differently:\n{yaml.dump(theirs[name])}")


def validate(manifest):
    name = name_of(manifest)
    check("namespace" not in manifest["metadata"], f"{name} names a namespace, which overlays are to choose")
    schema = CUSTOM.get((manifest["apiVersion"], manifest["kind"]))
    try:
        if schema is not None:
            jsonschema.validate(manifest["spec"], schema)
            return
        for release in RELEASES:
            kubernetes_validate.validate(manifest, release, strict=True)
    except jsonschema.ValidationError as error:
        failures.append(f"{name}: /{'/'.join(map(str, error.absolute_path))}: {error.message}")


def selects(selector, manifest_or_template):
    labels = manifest_or_template["metadata"]["labels"]
    return selector.items() <= labels.items()


def check_workload(manifest, user, options):
    """Pods of one workload: their rights, volumes, ports and variables."""
    name, template = name_of(manifest), manifest["spec"]["template"]
    check(selects(manifest["spec"]["selector"]["matchLabels"], template), f"{name} does not select its own pods")
    pod = template["spec"]
    check(pod.get("automountServiceAccountToken") is False, f"{name} gets a token of the cluster")
    check(pod.get("enableServiceLinks") is False, f"{name} gets variables of services, which look like options")
    rights = pod["securityContext"]
    ids = {key: rights.get(key) for key in ("runAsUser", "runAsGroup", "fsGroup")}
    check(set(ids.values()) == {user}, f"{name} runs with {ids}, the image with {user}")
    check(rights.get("runAsNonRoot") is True, f"{name} may run as root")
    check(rights.get("seccompProfile") == {"type": "RuntimeDefault"}, f"{name} has no seccomp profile")
    volumes = {volume["name"] for volume in pod["volumes"]}
    volumes |= {claim["metadata"]["name"] for claim in manifest["spec"].get("volumeClaimTemplates", [])}
    for container in pod["containers"]:
        check(container["securityContext"] == {
            "allowPrivilegeEscalation": False, "readOnlyRootFilesystem": True, "capabilities": {"drop": ["ALL"]},
        }, f"{name}: the container {container['name']} has more rights than compose.yaml gives")
        mounted = {mount["name"] for mount in container["volumeMounts"]}
        check(mounted == volumes, f"{name}: volumes {volumes}, mounted {mounted}")
        ports = {port["name"] for port in container.get("ports", [])}
        for probe in ("startupProbe", "readinessProbe", "livenessProbe"):
            port = container.get(probe, {}).get("httpGet", {}).get("port")
            check(port is None or port in ports, f"{name}: {probe} asks at {port}, there is {ports}")
        names = {entry["name"] for entry in container["env"]}
        used = set(re.findall(r"\$\(([A-Z_]+)\)", " ".join(container["args"])))
        check(used <= names, f"{name}: the arguments name {used - names}, which is not set")
        ours = {entry for entry in names if entry.startswith("PACKSTONE_")}
        check(names - ours <= used, f"{name}: nothing reads {names - ours - used}")
        if options is not None:
            command, *arguments = container["args"]
            ours |= {argument for argument in arguments if argument.startswith("--")}
            known = options(command)
            check(ours <= known, f"{name}: `packstone {command}` does not know {ours - known}")


def check_relations(manifests):
    """That what names another object names one that exists, and that the numbers of two objects fit."""
    by_name = {name_of(manifest): manifest for manifest in manifests}
    pods = [manifest for manifest in manifests if containers_of(manifest)]
    server, worker = by_name["StatefulSet/packstone-server"], by_name["Deployment/packstone-worker"]
    service = by_name["Service/packstone-server"]
    (server_container,), (worker_container,) = containers_of(server), containers_of(worker)
    server_env, worker_env = (
        {entry["name"]: entry for entry in container["env"]} for container in (server_container, worker_container))
    check(server["spec"]["replicas"] == 1, "the data directory has one user")
    check(selects(service["spec"]["selector"], server["spec"]["template"]), "the Service does not select the server")
    check(not selects(service["spec"]["selector"], worker["spec"]["template"]), "the Service selects workers")
    check(server["spec"]["serviceName"] == service["metadata"]["name"], "the StatefulSet names another Service")
    ports = {port["name"]: port["containerPort"] for port in server_container["ports"]}
    (entry,) = service["spec"]["ports"]
    check(ports.get(entry["targetPort"]) == 8080, "the Service leads to no port of the server")
    address = f"http://{service['metadata']['name']}:{entry['port']}"
    check(worker_env["PACKSTONE_SERVER"]["value"] == address, f"workers do not ask {address}")
    check(server_container["image"] == worker_container["image"], "server and workers run different images")
    resources = worker_container["resources"]
    cpus = int(resources["limits"]["cpu"])
    check(resources["requests"] == resources["limits"], "a worker's requests differ from its limits")
    check(worker_env["PACKSTONE_SLOTS"]["valueFrom"]["resourceFieldRef"] == {
        "containerName": worker_container["name"], "resource": "limits.cpu"}, "slots are not the CPUs")
    packing_mib = int(server_env["PACKSTONE_MAX_MEMORY_MIB"]["value"])
    memory_mib = 1024 * int(resources["limits"]["memory"].removesuffix("Gi"))
    check(cpus * packing_mib <= 0.8 * memory_mib, f"{cpus} packings of {packing_mib} MiB in {memory_mib} MiB")
    for manifest in manifests:
        name, spec = name_of(manifest), manifest.get("spec", {})
        selectors = []
        if manifest["kind"] == "NetworkPolicy":
            selectors = [spec["podSelector"]["matchLabels"]]
            for rule in spec.get("egress", []):
                selectors += [to["podSelector"]["matchLabels"] for to in rule["to"] if "namespaceSelector" not in to]
            for rule in spec.get("ingress", []) + spec.get("egress", []):
                numbers = {port["port"] for port in rule["ports"]}
                check(numbers in ({8080}, {53}), f"{name} opens {numbers}")
        elif manifest["kind"] == "PodDisruptionBudget":
            selectors = [spec["selector"]["matchLabels"]]
        elif manifest["kind"] == "ServiceMonitor":
            check(selects(spec["selector"]["matchLabels"], service), f"{name} does not select the Service")
            check(spec["endpoints"][0]["port"] == entry["name"], f"{name} names no port of the Service")
        elif manifest["kind"] == "ScaledObject":
            target = f"{spec['scaleTargetRef'].get('kind', 'Deployment')}/{spec['scaleTargetRef']['name']}"
            check(target in by_name, f"{name} scales {target}, which does not exist")
            check("replicas" not in by_name[target]["spec"], f"{target} is scaled by {name} and sets replicas")
            thresholds = {trigger["metadata"]["query"]: int(trigger["metadata"]["threshold"])
                          for trigger in spec["triggers"]}
            check(thresholds == {"sum(packstone_queue_work_seconds)": SECONDS_PER_SLOT * cpus,
                                 'sum(packstone_jobs{state="running"})': cpus}, f"{name}: {thresholds}")
        for selector in selectors:
            found = any(selects(selector, pod["spec"]["template"]) for pod in pods)
            check(found, f"{name} selects no pods: {selector}")


def options_of(binary):
    """A function from a command to the options and the variables of the environment that its help lists."""
    @functools.cache
    def known(command):
        asked = subprocess.run([binary, command, "--help"], capture_output=True, text=True, check=False)
        check(asked.returncode == 0, f"there is no command `packstone {command}`")
        return set(re.findall(r"\[env: (PACKSTONE_[A-Z_]+)|(?<!\S)(--[a-z-]+)", asked.stdout))
    return lambda command: {one for pair in known(command) for one in pair}


def check_kubernetes(options):
    dockerfile = (ROOT / "docker" / "Dockerfile").read_text()
    (user,) = re.findall(r"^USER (\d+):\1$", dockerfile, re.MULTILINE)
    used, kustomizations = set(), sorted(KUBERNETES.glob("*/kustomization.yaml"))
    assert kustomizations, f"no kustomization below {KUBERNETES}"
    for path in kustomizations:
        manifests = build(path.parent, used)
        compare_with_kustomize(path.parent, manifests)
        for manifest in manifests:
            validate(manifest)
            if containers_of(manifest):
                check_workload(manifest, int(user), options)
        check_relations(manifests)
        print(f"{path.parent.relative_to(ROOT)}: {len(manifests)} objects, Kubernetes {' and '.join(RELEASES)}")
    left = set(KUBERNETES.rglob("*.*")) - used
    check(not left, f"no kustomization names {[str(path) for path in left]}")


class Unit(configparser.RawConfigParser):
    """A unit of systemd: keys keep their case, and a key may stand several times."""

    def __init__(self, path):
        super().__init__(strict=False, delimiters=["="], comment_prefixes=["#"])
        self.optionxform = str
        self.read(path)
        self.lines = [line for line in path.read_text().splitlines() if re.match(r"[A-Z]\w+=", line)]


def check_units(options):
    units = {path.stem: Unit(path) for path in sorted(PACKAGING.glob("*.service"))}
    hardening = {}
    for name, unit in units.items():
        section = unit["Service"]
        rights = re.compile(r"(No|Protect|Private|Restrict|Lock|MemoryDeny|RemoveIPC|Capab|Ambient|SystemCall|UMask)")
        hardening[name] = [line for line in unit.lines if rights.match(line)]
        check(section.get("DynamicUser") == "yes", f"{name} has no user of its own")
        environment = PACKAGING / f"{name}.env"
        check(section["EnvironmentFile"] == f"/etc/packstone/{environment.name}", f"{name} reads another file")
        program, command = section["ExecStart"].split()
        check(program == "packstone", f"{name} starts {program}, which is not where both packages and installs by hand are")
        names = set(re.findall(r"^#?(PACKSTONE_\w+)=", environment.read_text(), re.MULTILINE))
        names |= {line.split("=")[1] for line in unit.lines if line.startswith("Environment=")}
        if options is not None:
            check(names <= options(command), f"{name}: `packstone {command}` does not know {names - options(command)}")
    for name, rights in hardening.items():
        check(rights == hardening["packstone"], f"{name} has other rights than packstone: {rights}")
    tool = shutil.which("systemd-analyze")
    if tool is None:
        print("manifests.py: no systemd-analyze; the units were compared only")
        return
    with tempfile.TemporaryDirectory() as folder:
        for name in units:
            # The program must exist.
            text = (PACKAGING / f"{name}.service").read_text().replace("ExecStart=packstone", "ExecStart=/bin/true")
            path = Path(folder) / f"{name}.service"
            path.write_text(text)
            for command in (["verify", "--man=no", path],
                            ["security", "--no-pager", "--offline=yes", f"--threshold={MOST_EXPOSED}", path]):
                judged = subprocess.run([tool, *command], capture_output=True, text=True, check=False)
                said = judged.stderr.strip() or judged.stdout.strip()
                check(judged.returncode == 0 and not (command[0] == "verify" and said), f"{name}: {command[0]}: {said}")
        print(f"packaging: {', '.join(units)} by systemd-analyze")


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--binary", type=Path, help="the program whose options the variables are compared with")
    binary = parser.parse_args().binary
    options = options_of(binary.resolve()) if binary else None
    check_kubernetes(options)
    check_units(options)
    if failures:
        sys.exit("\n".join(["manifests.py: faults:", *failures]))


if __name__ == "__main__":
    main()
