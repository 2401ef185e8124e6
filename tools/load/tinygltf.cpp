// tinygltf's own translation unit. Its writer, which is never called, still wants file streams.
#include <fstream>
#include <sstream>

#define TINYGLTF_IMPLEMENTATION
#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wunused-function"
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif
#include "tools/load/tinygltf.h"
