"""Checks Kubernetes manifests: manifests.py BINARIES FILE…

Each object strictly against the schemas of Kubernetes 1.33 and 1.37; each
command's options against the program's own help; each secret against what docs/deploy.md makes.
"""

import subprocess
import sys

import kubernetes_validate
import yaml

binaries, *files = sys.argv[1:]
# Not Kubernetes' own, so no schema of it is published there.
FOREIGN = {"kustomize.config.k8s.io/v1beta1", "keda.sh/v1alpha1"}
versions = ["1.33", "1.37"]
page = open("docs/deploy.md").read()
checked = commands = 0
problems = []


def options(program):
    """The long options that a program has."""
    text = subprocess.run([f"{binaries}/{program}", "--help"], capture_output=True, text=True, check=True).stdout
    return {word.rstrip(",.;)") for word in text.split() if word.startswith("--")}


def containers(spec):
    return spec.get("template", {}).get("spec", {}).get("containers", [])


for name in files:
    for document in yaml.safe_load_all(open(name)):
        if document is None or document["apiVersion"] in FOREIGN:
            continue
        what = f"{document['kind']} {document['metadata']['name']}"
        for version in (versions[0], versions[-1]):
            try:
                kubernetes_validate.validate(document, version, strict=True)
            except kubernetes_validate.ValidationError as error:
                problems.append(f"{what}, Kubernetes {version}: {error.message}")
        checked += 1
        for container in containers(document.get("spec", {})):
            program, *arguments = container["command"]
            known = options(program)
            commands += 1
            for argument in arguments:
                if argument.split("=")[0] not in known:
                    problems.append(f"{what}: {program} has no option {argument}")
            for variable in container.get("env", []):
                secret = variable.get("valueFrom", {}).get("secretKeyRef")
                if secret and f"secret generic {secret['name']}" not in page:
                    problems.append(f"{what}: docs/deploy.md makes no secret {secret['name']}")
        for volume in document.get("spec", {}).get("template", {}).get("spec", {}).get("volumes", []):
            secret = volume.get("secret", {}).get("secretName")
            if secret and f"secret generic {secret}" not in page:
                problems.append(f"{what}: docs/deploy.md makes no secret {secret}")

for problem in problems:
    print(problem, file=sys.stderr)
assert checked >= 9 and commands >= 2, f"only {checked} objects and {commands} commands were found"
sys.exit(1 if problems else print(f"{checked} objects and {commands} commands are as {versions[0]} and {versions[-1]} want them"))
