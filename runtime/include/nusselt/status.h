// What a call answers. The library never throws across its border, prints or aborts.
#pragma once

#include <cstdint>

namespace nusselt {

enum class StatusCode : uint32_t {
    ok = 0,
    invalid_argument, // a descriptor that cannot be meant; nothing was changed
    out_of_memory,    // the allocator returned null; nothing was changed
    stale_handle,     // the handle's object is gone, or belongs to another context
    busy,             // the object is in use by a frame in flight
    unsupported,      // a feature, version or instruction set that this build or machine lacks
    changed,          // a borrowed array was written while a frame read it (NUSSELT_CHECKED builds only)
};

// `text` is a static string that names the consequence and the cure; never null, valid for ever.
struct [[nodiscard]] Status {
    StatusCode code = StatusCode::ok;
    const char* text = "ok";

    constexpr bool ok() const { return code == StatusCode::ok; }
};

} // namespace nusselt
