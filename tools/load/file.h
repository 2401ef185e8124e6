// Reading files that nobody vouches for.
#pragma once

#include "tools/load/model.h"

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace nusselt::load {

using Bytes = std::vector<uint8_t>;

// The whole of a regular file of at most `limit` bytes. Anything else (a folder, a FIFO, a device) is an
// error, found without waiting for it.
Bytes read_file(const std::string& path, uint64_t limit);

// The file that a relative URI names, beneath the folder of `asset_path` and nowhere else: no scheme, no
// absolute path, no "..", before or after percent-decoding (once), and no symbolic link on the way.
Bytes read_beneath(const std::string& asset_path, const std::string& uri, uint64_t limit,
                   const std::string& where);

// "data:...": the bytes it holds, base64 or percent-encoded.
Bytes decode_data_uri(std::string_view uri, const std::string& where);

} // namespace nusselt::load
