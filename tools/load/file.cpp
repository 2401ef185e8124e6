#include "tools/load/file.h"

#include "tools/load/error.h"

#include <cerrno>
#include <cstring>
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

namespace nusselt::load {
namespace {

struct File {
    int descriptor = -1;
    explicit File(int opened) : descriptor(opened) {}
    File(const File&) = delete;
    File& operator=(const File&) = delete;
    ~File() {
        if (descriptor >= 0) close(descriptor);
    }
};

std::string megabytes(uint64_t bytes) {
    return std::to_string((bytes + (1u << 20) - 1) >> 20) + " MiB";
}

// `name` leads the message: "the file", or which of the files that it references.
Bytes read_open(const File& file, uint64_t limit, const std::string& name, const std::string& where) {
    struct stat status {};
    if (fstat(file.descriptor, &status) != 0) {
        fail("IO", where, name + " can't be examined", "check its permissions");
    }
    if (!S_ISREG(status.st_mode)) {
        fail("NOT_A_FILE", where, name + " is not a regular file",
             "name a file, not a folder, pipe or device");
    }
    const auto size = static_cast<uint64_t>(status.st_size);
    if (size > limit) {
        fail("LIMIT_FILE_SIZE", where,
             name + " has " + megabytes(size) + ", the limit is " + megabytes(limit),
             "raise the limit if you trust it");
    }
    Bytes bytes(size);
    size_t done = 0;
    while (done < bytes.size()) {
        const ssize_t got = read(file.descriptor, bytes.data() + done, bytes.size() - done);
        if (got < 0 && errno == EINTR) continue;
        if (got < 0) fail("IO", where, name + " can't be read: " + std::strerror(errno), "check the disk");
        if (got == 0) break; // it became shorter since fstat
        done += static_cast<size_t>(got);
    }
    bytes.resize(done);
    return bytes;
}

[[noreturn]] void fail_to_open(const std::string& name, const std::string& where) {
    const int error = errno;
    if (error == ELOOP || error == ENOTDIR) {
        fail("UNSAFE_URI", where, name + " goes through a symbolic link or a file",
             "put a plain file in its place");
    }
    fail(error == ENOENT ? "FILE_MISSING" : "IO", where, name + " can't be opened: " + std::strerror(error),
         error == ENOENT ? "check its name and place" : "check its permissions");
}

int hex(char c) {
    if (c >= '0' && c <= '9') return c - '0';
    if (c >= 'a' && c <= 'f') return c - 'a' + 10;
    if (c >= 'A' && c <= 'F') return c - 'A' + 10;
    return -1;
}

std::string percent_decode(std::string_view text) {
    std::string out;
    out.reserve(text.size());
    for (size_t i = 0; i < text.size(); ++i) {
        if (text[i] == '%' && i + 2 < text.size() && hex(text[i + 1]) >= 0 && hex(text[i + 2]) >= 0) {
            out += static_cast<char>(hex(text[i + 1]) * 16 + hex(text[i + 2]));
            i += 2;
        } else {
            out += text[i];
        }
    }
    return out;
}

int base64(char c) {
    if (c >= 'A' && c <= 'Z') return c - 'A';
    if (c >= 'a' && c <= 'z') return c - 'a' + 26;
    if (c >= '0' && c <= '9') return c - '0' + 52;
    if (c == '+' || c == '-') return 62; // '-' and '_': the URL-safe alphabet
    if (c == '/' || c == '_') return 63;
    return -1;
}

} // namespace

Bytes read_file(const std::string& path, uint64_t limit) {
    // O_NONBLOCK: opening a FIFO that nobody writes must not wait.
    const File file(open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY));
    if (file.descriptor < 0) fail_to_open("the file", "");
    return read_open(file, limit, "the file", "");
}

Bytes read_beneath(const std::string& asset_path, const std::string& uri, uint64_t limit,
                   const std::string& where) {
    const std::string name = "'" + printable(uri) + "'";
    const auto unsafe = [&](const char* why) {
        fail("UNSAFE_URI", where, name + " " + why,
             "only files beneath the model's own folder are read; move it there");
    };
    const std::string decoded = percent_decode(uri);
    if (decoded.empty()) fail("URI_EMPTY", where, "a buffer's uri is empty", export_again);
    for (const std::string& form : {uri, decoded}) {
        if (form.find('\0') != std::string::npos) unsafe("has a zero byte");
        if (form.find('\\') != std::string::npos) unsafe("has a backslash");
        if (form[0] == '/') unsafe("is an absolute path");
        const size_t colon = form.find(':');
        if (colon != std::string::npos && colon < form.find('/')) unsafe("has a scheme");
    }

    const size_t slash = asset_path.rfind('/');
    const std::string folder = slash == std::string::npos ? "." : asset_path.substr(0, slash + 1);
    int directory = open(folder.c_str(), O_RDONLY | O_CLOEXEC | O_DIRECTORY);
    if (directory < 0) fail_to_open("the model's folder", where);

    // One component at a time, no links: the path can't leave the folder, whatever the file system does
    // meanwhile.
    size_t begin = 0;
    for (;;) {
        const File parent(directory);
        const size_t end = decoded.find('/', begin);
        const std::string part = decoded.substr(begin, end == std::string::npos ? end : end - begin);
        if (part == "..") unsafe("leaves the folder");
        if (end == std::string::npos) {
            const File file(openat(parent.descriptor, part.c_str(),
                                   O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY | O_NOFOLLOW));
            if (file.descriptor < 0) fail_to_open(name, where);
            return read_open(file, limit, name, where);
        }
        directory = openat(parent.descriptor, part.empty() ? "." : part.c_str(),
                           O_RDONLY | O_CLOEXEC | O_DIRECTORY | O_NOFOLLOW);
        if (directory < 0) fail_to_open(name, where);
        begin = end + 1;
    }
}

Bytes decode_data_uri(std::string_view uri, const std::string& where) {
    const size_t comma = uri.find(',');
    if (comma == std::string_view::npos) {
        fail("DATA_URI", where, "a data URI has no comma", export_again);
    }
    const std::string_view head = uri.substr(0, comma);
    std::string_view body = uri.substr(comma + 1);
    constexpr std::string_view marker = ";base64";
    if (head.size() < marker.size() || head.substr(head.size() - marker.size()) != marker) {
        const std::string text = percent_decode(body);
        return Bytes(text.begin(), text.end());
    }
    while (!body.empty() && body.back() == '=') {
        body.remove_suffix(1);
    }
    if (body.size() % 4 == 1) fail("DATA_URI", where, "a data URI's base64 is cut off", file_incomplete);
    Bytes out;
    out.reserve(body.size() / 4 * 3 + 3);
    uint32_t bits = 0;
    uint32_t count = 0;
    for (const char c : body) {
        const int value = base64(c);
        if (value < 0) {
            fail("DATA_URI", where, "a data URI has the byte '" + printable({&c, 1}) + "', not base64",
                 export_again);
        }
        bits = (bits << 6) | static_cast<uint32_t>(value);
        count += 6;
        if (count >= 8) {
            count -= 8;
            out.push_back(static_cast<uint8_t>(bits >> count));
        }
    }
    return out;
}

} // namespace nusselt::load
