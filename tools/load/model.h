// Model files: glTF 2.0 and GLB, OBJ, PLY. Geometry and its animation only: textures are never opened.
#pragma once

#include "bench/scenes/scene.h"

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace nusselt::load {

// Everything is checked against these before memory is asked for.
struct LoadLimits {
    uint64_t json_bytes = 64ull << 20; // without the data URIs
    uint64_t json_tokens = 8'000'000;
    uint32_t json_depth = 64;
    uint64_t data_uri_bytes = 256ull << 20; // of one data URI, as text
    uint64_t buffer_bytes =
        2ull << 30;               // all buffers together, decompressed ones included; also an OBJ or PLY file
    uint64_t elements = 1u << 20; // nodes, and each other array of the document
    uint64_t vertices = 1u << 27; // drawn: each instance counts
    uint64_t triangles = 1u << 27; // drawn
    uint32_t joints = 1u << 16;    // of one skin
    uint32_t node_depth = 1024;
};

// One problem. All texts are printable ASCII on one line, whatever the file holds.
struct LoadError {
    std::string code;  // upper case, stable, for scripts: "ACCESSOR_TOO_LONG"
    std::string where; // a JSON pointer ("/accessors/7"), "line 12", or empty: the file as a whole
    std::string what;  // what is wrong
    std::string cure;  // what to do
};

// "FILE: what is wrong (where); what to do [CODE]", for stderr behind the program's name.
std::string describe(const std::string& path, const LoadError& error);

// One animation of the file.
struct Clip {
    std::string name;               // empty where the file gives none
    double duration = 0;            // seconds: the last key
    std::vector<std::string> paths; // what it moves: translation, rotation, scale, weights, pointer; sorted
};

struct Rig; // nodes, skins, morph targets and keys, shared by all scenes made from the model

struct Model {
    std::string name; // the file's, without folders
    // One for each node that draws a mesh, all its primitives together; or one for an OBJ or PLY file.
    // Positions are the file's (mesh space, no morph target applied). A mesh that its node mirrors (negative
    // scale) as the nodes stand is stored mirrored in x, so that counter-clockwise is outside here as well as
    // in every pose.
    std::vector<scenes::Mesh> meshes;
    std::vector<Clip> clips;
    std::vector<std::string> warnings; // one line each, printable ASCII

    // For reports: what the file holds, drawn or not.
    std::string format;    // "glTF", "GLB", "OBJ", "PLY"
    std::string generator; // empty where the file names none
    std::vector<std::string> extensions;
    size_t stored_vertices = 0;  // each POSITION accessor counted once
    size_t stored_triangles = 0; // each glTF mesh counted once
    size_t nodes = 0;
    size_t materials = 0;
    size_t skins = 0;
    size_t joints = 0;                 // of the largest skin
    size_t morph_targets = 0;          // of the mesh with the most
    size_t meshes_without_normals = 0; // drawn meshes with vertices whose normals are computed in every pose

    std::shared_ptr<const Rig> rig;
};

struct LoadResult {
    bool ok = false;
    Model model;     // where ok
    LoadError error; // where not
};

// Reads the file, and what it references beneath its own folder. Throws nothing, prints nothing.
LoadResult load_model(const std::string& path, const LoadLimits& limits = {});

// The model moved by clip `clip` (0 ... clips.size() - 1), or with its nodes as they stand (-1; any other
// number out of range too). The scene shares the model's data and outlives it.
//
// Winding is decided once, from how the nodes stand. While a clip turns the sign of a node's scale over, its
// faces are seen from inside; normals stay outside.
scenes::Scene make_scene(const Model& model, int clip);

} // namespace nusselt::load
