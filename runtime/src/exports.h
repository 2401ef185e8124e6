// Included ahead of every source of the runtime by its CMakeLists.txt: gives the public functions default
// visibility and leaves all else hidden, so that the public headers need no export macro.
#pragma once

#pragma GCC visibility push(default)
#include "nusselt/nusselt.h"
#pragma GCC visibility pop
