#include "tests/fuzz/fuzz.h"
#include "tests/fuzz/model_checks.h"
#include "tools/load/formats.h"

namespace nusselt::fuzz {

// PLY where it begins so, OBJ otherwise, as the program decides.
int obj_ply(const uint8_t* data, size_t size) {
    const load::Bytes file(data, data + size);
    try {
        const bool ply = size >= 4 && std::memcmp(data, "ply", 3) == 0;
        const load::Model model = ply ? load::read_ply("/nonexistent/model.ply", file, small_limits())
                                      : load::read_obj("/nonexistent/model.obj", file, small_limits());
        check_model(model);
#if defined(NUSSELT_PLANT)
        // Indices counted from one, once more, in polygons of more than four corners.
        for (const scenes::Mesh& mesh : model.meshes) {
            if (mesh.indices.size() < 9) continue;
            for (const uint32_t i : mesh.indices) {
                volatile float x = (&mesh.rest_positions[0] + i + 1)->x;
                (void)x;
            }
        }
#endif
    } catch (const load::LoadError& error) {
        check_error(error);
    }
    return 0;
}

} // namespace nusselt::fuzz
