#include "visibility/isa.h"

#include "lpvbake/error.h"

#include <algorithm>
#include <string>

namespace lpvbake::visibility {

/// What Embree's code for a set is compiled for.
bool processor_has(Isa isa) {
#if defined(__x86_64__)
    switch (isa) {
    case Isa::avx:
        return __builtin_cpu_supports("avx");
    case Isa::avx2:
        return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")
               && __builtin_cpu_supports("bmi") && __builtin_cpu_supports("bmi2");
    case Isa::avx512:
        return processor_has(Isa::avx2) && __builtin_cpu_supports("avx512f")
               && __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512cd")
               && __builtin_cpu_supports("avx512bw") && __builtin_cpu_supports("avx512vl");
    default:
        return true;
    }
#else
    return isa == Isa::automatic || isa == Isa::sse2; // which Embree translates
#endif
}

const char* name_of(Isa isa) {
    switch (isa) {
    case Isa::automatic:
        return "auto";
    case Isa::sse2:
        return "sse2";
    case Isa::avx:
        return "avx";
    case Isa::avx2:
        return "avx2";
    case Isa::avx512:
        return "avx512";
    }
    return "";
}

std::optional<Isa> isa_named(std::string_view name) {
    const auto* found = std::ranges::find(isas, name, name_of);
    return found == isas.end() ? std::nullopt : std::optional(*found);
}

Isa available(Isa isa, bool (*has)(Isa)) {
    if (isa == Isa::automatic) {
        for (const Isa most : {Isa::avx2, Isa::avx})
            if (has(most))
                return most;
        return Isa::sse2;
    }
    if (!has(isa))
        throw Error(ErrorKind::argument, std::string("`isa` ") + name_of(isa)
                                             + ": this processor does not have it; it has "
                                             + name_of(available(Isa::automatic, has)));
    return isa;
}

} // namespace lpvbake::visibility
