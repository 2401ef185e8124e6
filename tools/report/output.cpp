#include "tools/report/output.h"

#include "tools/report/failure.h"

#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fcntl.h>
#include <filesystem>
#include <mutex>
#include <sys/file.h>
#include <sys/stat.h>
#include <system_error>
#include <unistd.h>

namespace nusselt::tools {

namespace fs = std::filesystem;

namespace {

[[noreturn]] void fail(const std::string& path, const char* what, int error, const char* cure) {
    throw Failure(path, std::string(what) + " (" + std::strerror(error) + "); " + cure);
}

constexpr const char* cure_directory = "choose a directory that you may write to with --out";
constexpr const char* cure_space = "free some space or choose another place with --out";

// mkstemp and mkdtemp make files for the owner alone; results get the usual permissions.
mode_t usual_mode(mode_t mode) {
    const mode_t mask = umask(0);
    umask(mask);
    return mode & ~mask;
}

struct Descriptor {
    int number;
    ~Descriptor() {
        if (number >= 0) ::close(number);
    }
};

// Takes over `file` and closes it. False with errno set when a write failed.
bool write_all(int file, std::string_view bytes) {
    while (!bytes.empty()) {
        const ssize_t written = ::write(file, bytes.data(), bytes.size());
        if (written < 0 && errno == EINTR) continue;
        if (written <= 0) {
            const int error = written < 0 ? errno : ENOSPC;
            ::close(file);
            errno = error;
            return false;
        }
        bytes.remove_prefix(static_cast<size_t>(written));
    }
    return ::close(file) == 0;
}

} // namespace

void write_file(const std::string& path, std::string_view bytes) {
    std::string temporary = path + ".XXXXXX";
    const int file = mkstemp(temporary.data());
    if (file < 0) fail(path, "cannot be written", errno, "choose a place that you may write to");
    fchmod(file, usual_mode(0666));
    if (!write_all(file, bytes) || std::rename(temporary.c_str(), path.c_str()) != 0) {
        const int error = errno;
        ::unlink(temporary.c_str());
        fail(path, "cannot be written", error, cure_space);
    }
}

namespace {

// Whoever holds it is the only one to touch results.
std::mutex outputs;
OutputDirectory* gathering = nullptr;
bool any_committed = false;

} // namespace

OutputDirectory::OutputDirectory(const std::string& path) : path_(path) {
    const std::lock_guard lock(outputs);
    open();
    gathering = this;
}

void OutputDirectory::open() {
    while (path_.size() > 1 && path_.back() == '/')
        path_.pop_back();
    if (path_.empty()) throw Failure("--out", "the name of the directory is empty; give one", exit_usage);
    struct stat status;
    existed_ = ::stat(path_.c_str(), &status) == 0;
    if (existed_ && !S_ISDIR(status.st_mode)) {
        throw Failure(path_, "exists and is not a directory; choose another name with --out");
    }
    if (!existed_ && errno != ENOENT) fail(path_, "cannot be used as a directory", errno, cure_directory);

    try {
        if (!existed_) {
            std::vector<std::string> missing;
            std::error_code ignored;
            fs::path parent = fs::path(path_).parent_path();
            for (; !parent.empty() && !fs::exists(parent, ignored); parent = parent.parent_path())
                missing.push_back(parent.string());
            for (auto name = missing.rbegin(); name != missing.rend(); ++name) {
                if (::mkdir(name->c_str(), 0777) != 0) {
                    if (errno == EEXIST) continue;
                    fail(path_, "cannot be made", errno, cure_directory);
                }
                made_.push_back(*name);
            }
        }
        const fs::path target(path_);
        fs::path beside = existed_ ? target / ".nusselt" : target.parent_path() / ".";
        if (!existed_) beside += target.filename();
        beside += "-XXXXXX";
        std::string name = beside.string();
        if (!mkdtemp(name.data())) {
            fail(path_, existed_ ? "cannot be written to" : "cannot be made", errno, cure_directory);
        }
        staging_ = name;
        ::chmod(staging_.c_str(), usual_mode(0777));
    } catch (...) {
        for (auto made = made_.rbegin(); made != made_.rend(); ++made)
            ::rmdir(made->c_str());
        throw;
    }
}

OutputDirectory::~OutputDirectory() {
    const std::lock_guard lock(outputs);
    if (gathering == this) gathering = nullptr;
    remove();
}

void OutputDirectory::remove() {
    if (!staging_.empty()) {
        std::error_code ignored;
        fs::remove_all(staging_, ignored);
    }
    if (committed_) return;
    for (auto name = made_.rbegin(); name != made_.rend(); ++name)
        ::rmdir(name->c_str());
}

void OutputDirectory::add(const std::string& name, std::string_view bytes) {
    const std::lock_guard lock(outputs);
    const std::string target = path_ + "/" + name;
    const std::string staged = staging_ + "/" + name;
    if (const size_t slash = name.find('/'); slash != std::string::npos) {
        const std::string directory = staging_ + "/" + name.substr(0, slash);
        if (::mkdir(directory.c_str(), 0777) != 0 && errno != EEXIST) {
            fail(target, "cannot be written", errno, cure_space);
        }
    }
    const int file = ::open(staged.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
    if (file < 0 || !write_all(file, bytes)) fail(target, "cannot be written", errno, cure_space);
    names_.push_back(name);
}

void OutputDirectory::commit() {
    const std::lock_guard lock(outputs);
    if (!existed_ && std::rename(staging_.c_str(), path_.c_str()) == 0) {
        staging_.clear();
        any_committed = committed_ = true;
        return;
    }
    // Another run into the same directory waits, so that the files there are one run's. The kernel lets go of
    // the lock when this process ends, however it ends.
    const Descriptor held{::open(path_.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC)};
    while (held.number >= 0 && ::flock(held.number, LOCK_EX) != 0 && errno == EINTR) {
    }
    // Everything that can be known to fail is looked at before the first file moves.
    for (const std::string& name : names_) {
        const std::string target = path_ + "/" + name;
        struct stat status;
        if (::lstat(target.c_str(), &status) == 0 && S_ISDIR(status.st_mode)) {
            throw Failure(target, "is a directory where a result should go; move it or choose another --out");
        }
        if (const size_t slash = name.find('/'); slash != std::string::npos) {
            const std::string directory = path_ + "/" + name.substr(0, slash);
            if (::mkdir(directory.c_str(), 0777) != 0 && errno != EEXIST) {
                fail(directory, "cannot be made", errno, cure_directory);
            }
            if (::access(directory.c_str(), W_OK | X_OK) != 0) {
                fail(directory, "cannot be written to", errno, cure_directory);
            }
        }
    }
    for (const std::string& name : names_) {
        const std::string target = path_ + "/" + name;
        if (std::rename((staging_ + "/" + name).c_str(), target.c_str()) != 0) {
            fail(target, "cannot be written", errno, cure_directory);
        }
    }
    any_committed = committed_ = true;
}

bool abandon_output() {
    outputs.lock();
    if (any_committed) {
        outputs.unlock();
        return false;
    }
    if (gathering) gathering->remove();
    return true;
}

} // namespace nusselt::tools
