#!/usr/bin/env bash
# The image of the Dockerfile where no registry of images can be reached: .ci/packages/image.sh [FOLDER]
# Its base, Debian with Python, is made by mmdebstrap; buildah builds it without a daemon and runs its default command,
# as the user that the image names, without any right.  Needs root, mmdebstrap and buildah.  Into FOLDER go the report
# of the run, and a picture that was drawn inside by EGL.
set -euo pipefail
cd "$(dirname "$0")/../.."
out=$(realpath -m "${1:-image}")
mkdir -p "$out"
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
export BUILDAH_ISOLATION=chroot STORAGE_DRIVER=vfs
base=python:3.11-slim-bookworm

if ! buildah inspect --type image "localhost/$base" > /dev/null 2>&1; then
  mmdebstrap --quiet --variant=minbase --include=ca-certificates,python3,python3-venv bookworm "$work/root.tar"
  box=$(buildah from scratch)
  buildah add -q "$box" "$work/root.tar" /
  buildah run "$box" -- python3 -m venv /usr/local   # `python` and `pip` stand where they do in the image of that name
  buildah commit -q --rm "$box" "localhost/$base"
fi

mkdir "$work/context"
git archive HEAD | tar x -C "$work/context"
# what this machine needs to reach its package indexes holds inside, too
mounts=(-v /etc/ssl/certs:/etc/ssl/certs:ro)
for place in /etc/pip.conf ${IMAGE_MOUNTS:-}; do
  [ -e "$place" ] && mounts+=(-v "$place:$place:ro")
done
buildah bud -q --pull-never "${mounts[@]}" -f "$work/context/.ci/packages/Dockerfile" -t itouch-py "$work/context"

box=$(buildah from --pull-never localhost/itouch-py)
entry=$(buildah inspect --format '{{range .OCIv1.Config.Entrypoint}}{{.}} {{end}}' "$box")
default=$(buildah inspect --format '{{range .OCIv1.Config.Cmd}}{{.}} {{end}}' "$box")
inside() { buildah run "$box" -- "$@"; }   # as the image's user, in its folder
echo "user: $(inside id -un) ($(inside id -u)); entry point: $entry; default command: $default"
inside $entry $default
inside $entry demo --report report.json > /dev/null
inside $entry demo --scenes scenes > /dev/null
inside $entry run scenes/four_materials.xml --for 9s --no-record --screenshot picture.png > /dev/null
inside $entry doctor || true
for file in report.json picture.png; do inside cat "$file" > "$out/$file"; done
buildah images --format '{{.Name}} {{.Size}}' | grep itouch-py
buildah rm "$box" > /dev/null
