// Instruction sets that rays are traced with. Embree's answers with two of them differ by rounding.
#pragma once

#include <array>
#include <optional>
#include <string_view>

namespace lpvbake::visibility {

/// `automatic`: avx2, which nearly all have, so that they round alike; or the best up to it.
enum class Isa { automatic, sse2, avx, avx2, avx512 };
inline constexpr std::array<Isa, 5> isas{Isa::automatic, Isa::sse2, Isa::avx, Isa::avx2,
                                         Isa::avx512};

/// "auto", "sse2", ...
const char* name_of(Isa isa);
std::optional<Isa> isa_named(std::string_view name);

bool processor_has(Isa isa);

/// The one that is taken for it. Throws Error (argument) for one that the processor lacks.
Isa available(Isa isa, bool (*has)(Isa) = processor_has);

} // namespace lpvbake::visibility
