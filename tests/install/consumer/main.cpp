// A host: makes and destroys a context, which draws in kernels, jobs and the executor.
#include "nusselt/nusselt.h"

#include <cstdio>

int main() {
    if (nusselt::version() != NUSSELT_VERSION) {
        std::puts("header and library differ");
        return 1;
    }
    nusselt::Context* context = nullptr;
    const nusselt::Status made = nusselt::create_context({}, &context);
    if (!made.ok()) {
        std::puts(made.text);
        return 1;
    }
    std::puts(nusselt::configuration());
    return nusselt::destroy_context(context).ok() ? 0 : 1;
}
