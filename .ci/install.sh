#!/usr/bin/env bash
# Installs the Debian packages (bookworm) that the build, the tests and the examples need, with
# --clients also the large programs of the client tests, with --farm also Slurm; does nothing where
# all are there. Run as root or with sudo.
set -euo pipefail

packages=(
    # build
    cmake ninja-build g++ ccache glslc
    libvulkan-dev libembree-dev libtbb-dev libglm-dev libcli11-dev libtomlplusplus-dev nlohmann-json3-dev
    libtinygltf-dev libdraco-dev libmeshoptimizer-dev libopenvdb-dev libnanovdb-dev libboost-dev libzstd-dev libxxhash-dev
    libopenimageio-dev libopenexr-dev libimath-dev libpng-dev
    # run: a Vulkan driver for any CPU
    mesa-vulkan-drivers
    # run: what draws the plots of reports
    gnuplot-nox
    # test
    libgtest-dev libbenchmark-dev vulkan-validationlayers
    clang clang-tidy-14 libclang-rt-14-dev gcovr
    libopenvdb-tools libnanovdb-tools openimageio-tools python3 python3-openvdb python3-openimageio python3-numpy python3-jsonschema
)
for option in "$@"; do
    case $option in
    --clients)
        packages+=(blender chromium chromium-driver godot3-server nodejs libogre-1.12-dev
            mono-mcs mono-runtime mmdebstrap dpkg-dev zstd)
        ;;
    --farm) packages+=(slurm-wlm munge procps make iproute2 util-linux hostname) ;;
    esac
done

# A driver whose device traces rays, in a folder of its own: Debian's backports have it, and the
# system's stays as it is. Nothing but tests names it.
mesa=/opt/lpvbake-mesa mesa_version=25.0.7-2~bpo12+1

missing=()
for package in "${packages[@]}"; do
    status=$(dpkg-query -W -f '${db:Status-Status}' "$package" 2>/dev/null || true)
    [[ $status == installed ]] || missing+=("$package")
done
[[ ${#missing[@]} -gt 0 || ! -e $mesa/lvp.json ]] || exit 0

as_root=()
if [[ $(id -u) -ne 0 ]]; then
    command -v sudo >/dev/null || {
        echo "missing packages or $mesa, and neither root nor sudo to install them: ${missing[*]}" >&2
        exit 1
    }
    as_root=(sudo)
fi
if [[ ${#missing[@]} -gt 0 ]]; then
    echo "installing ${missing[*]}" >&2
    "${as_root[@]}" apt-get update -qq >&2
    "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive \
        apt-get install -qq -y --no-install-recommends "${missing[@]}" >&2
fi
[[ -e $mesa/lvp.json ]] && exit 0

echo "unpacking Mesa $mesa_version into $mesa" >&2
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
mkdir -p "$work/lists/partial" "$work/root"
echo "deb [signed-by=/usr/share/keyrings/debian-archive-keyring.gpg] http://deb.debian.org/debian bookworm-backports main" \
    >"$work/backports.list"
apt=(apt-get -qq -o "Dir::Etc::SourceList=$work/backports.list" -o Dir::Etc::SourceParts=/dev/null
    -o "Dir::State::Lists=$work/lists" -o "Dir::Cache=$work" -o Acquire::Retries=3 -o APT::Sandbox::User=root)
"${apt[@]}" update >&2
(cd "$work" && "${apt[@]}" download "mesa-vulkan-drivers=$mesa_version" >&2)
dpkg -x "$work"/mesa-vulkan-drivers_*.deb "$work/root"
library=$(cd "$work/root" && echo usr/lib/*/libvulkan_lvp.so)
"${as_root[@]}" mkdir -p "$mesa"
"${as_root[@]}" cp "$work/root/$library" "$mesa/libvulkan_lvp.so"
printf '{"file_format_version": "1.0.0", "ICD": {"api_version": "1.4.305", "library_path": "%s"}}\n' \
    "$mesa/libvulkan_lvp.so" >"$work/lvp.json"
"${as_root[@]}" cp "$work/lvp.json" "$mesa/lvp.json" # last: it says that all is there
