// Volumes of light that commands read: what they say of their own making, and how they are looked
// up.
#pragma once

#include "lpvbake/volume.h"
#include "options/option.h"
#include "readers/readers.h"
#include "reference/paths.h"
#include "scene/scene.h"
#include "volume/levels.h"
#include "volume/light_content.h"

#include <optional>
#include <string>

namespace lpvbake::cmd {

/// Throws Error (invalid) for differences and errors, and as read_volume does.
Volume read_light(const std::string& path);
/// The same of nested levels (io/levels.h); of any other file a set of one.
volume::VolumeSet read_levels(const std::string& path);

/// Throws Error (argument) for a scene that is named where the volume belongs; `usage` is how it is
/// right.
void check_order(const std::string& scene, const std::string& volume, const char* usage);

/// Whether the volume holds light of a kind of source; where that is unknown it is taken to.
bool holds(const Volume& volume, std::optional<volume::Reflections> volume::LightContent::*source);
/// Which light the volume holds, as its metadata say; all where they do not.
reference::PathRules rules_of(const Volume& volume);
/// Whether its field is that in a medium (bake --scattering).
bool is_in_air(const Volume& volume);
/// Makes those lights of the scene static whose direct light the volume holds. Throws Error
/// (invalid) where the volume's list of them is none.
void make_static(const std::string& path, const Volume& volume, Scene& scene);
/// A warning where the hash that the volume of this name has is not the scene's.
std::optional<std::string> mismatch(const std::string& path, const Volume& volume,
                                    const Scene& scene);
/// The same where surfaces that its operators are of (bake/local_transfer.h) are others.
std::optional<std::string> other_surfaces(const std::string& path, const Volume& volume,
                                          const Scene& scene);
/// Sets what of scene and light is not given as the volume's metadata record it. Throws Error
/// (invalid) for what is no value.
void take_light(const std::string& path, const Volume& volume, options::Options& options);

/// --sampler; null: auto.
void add_sampler_option(options::Options& options, const readers::Reader*& sampler);
/// The one that is asked for, else the program that the volume is fitted to or was written for,
/// else our own sampler.
readers::Reader sampler_for(const readers::Reader* asked, const Volume& volume);
/// As --sampler has it.
std::string sampler_name(const readers::Reader& sampler);
/// The volume as the sampler's target writes it, where that fills cells; a fitted one is filled.
std::optional<Volume> filled_for(const readers::Reader& sampler, const Volume& volume);
std::optional<volume::VolumeSet> filled_for(const readers::Reader& sampler,
                                            const volume::VolumeSet& levels);

} // namespace lpvbake::cmd
