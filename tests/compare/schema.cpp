#include "schema.h"

#include <nlohmann/json.hpp>

#include <set>

namespace nusselt::test {

namespace {

using nlohmann::json;

bool is_type(const json& value, const std::string& type) {
    if (type == "object") return value.is_object();
    if (type == "array") return value.is_array();
    if (type == "string") return value.is_string();
    if (type == "boolean") return value.is_boolean();
    if (type == "integer") return value.is_number_integer();
    if (type == "number") return value.is_number();
    return false;
}

void check(const json& root, const json& schema, const json& value, const std::string& where,
           std::vector<std::string>& out) {
    static const std::set<std::string> understood{"$schema",    "$id",         "$defs",
                                                  "title",      "description", "type",
                                                  "properties", "required",    "additionalProperties",
                                                  "items",      "enum",        "const",
                                                  "minimum",    "minItems",    "$ref"};
    for (const auto& [key, ignored] : schema.items())
        if (!understood.count(key)) out.push_back("the schema's '" + key + "' is not understood");
    if (schema.contains("$ref")) {
        const std::string name = schema["$ref"].get<std::string>().substr(std::string("#/$defs/").size());
        return check(root, root["$defs"].at(name), value, where, out);
    }
    if (schema.contains("type") && !is_type(value, schema["type"]))
        return out.push_back(where + " is no " + schema["type"].get<std::string>());
    if (schema.contains("const") && value != schema["const"])
        out.push_back(where + " is not " + schema["const"].dump());
    if (schema.contains("enum")) {
        bool found = false;
        for (const json& each : schema["enum"])
            found = found || each == value;
        if (!found) out.push_back(where + " is none of " + schema["enum"].dump());
    }
    if (schema.contains("minimum") && value.get<double>() < schema["minimum"].get<double>())
        out.push_back(where + " is below " + schema["minimum"].dump());
    if (value.is_array()) {
        if (schema.contains("minItems") && value.size() < schema["minItems"].get<size_t>())
            out.push_back(where + " has too few items");
        for (size_t k = 0; schema.contains("items") && k < value.size(); ++k)
            check(root, schema["items"], value[k], where + "/" + std::to_string(k), out);
    }
    if (!value.is_object()) return;
    for (const json& name : schema.value("required", json::array()))
        if (!value.contains(name.get<std::string>()))
            out.push_back(where + " lacks " + name.get<std::string>());
    const json properties = schema.value("properties", json::object());
    for (const auto& [name, part] : value.items()) {
        if (properties.contains(name)) {
            check(root, properties[name], part, where + "/" + name, out);
        } else if (schema.contains("additionalProperties")) {
            const json& other = schema["additionalProperties"];
            if (other.is_boolean()) {
                if (!other.get<bool>()) out.push_back(where + " has an unknown " + name);
            } else {
                check(root, other, part, where + "/" + name, out);
            }
        }
    }
}

} // namespace

std::vector<std::string> violations(const json& schema, const json& value) {
    std::vector<std::string> out;
    check(schema, schema, value, "", out);
    return out;
}

} // namespace nusselt::test
