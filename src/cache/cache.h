// What stages keep from bake to bake. A value is kept by a hash of all that it was made of, so that
// one is found where, and only where, making it again would give the same bytes.
#pragma once

#include <array>
#include <cstdint>
#include <cstring>
#include <functional>
#include <glm/glm.hpp>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

namespace lpvbake::cache {

/// XXH3, 128 bits: of other bytes it is another one. No protection against forgery.
std::array<uint64_t, 2> hash_of(std::string_view bytes);

/// This very build of the program, and the instructions that the processor offers to it: others may
/// round otherwise.
std::string program_id();

/// What a value is made of. It is bytes that tell it apart: numbers as they are, of arrays their
/// hash.
class Key {
public:
    explicit Key(std::string_view name) { add_text(name); }

    /// Values without padding.
    template <class... T>
    Key& add(const T&... values) {
        static_assert((std::is_trivially_copyable_v<T> && ...));
        (bytes_.append(reinterpret_cast<const char*>(&values), sizeof values), ...);
        return *this;
    }
    Key& add_text(std::string_view text) {
        add(uint64_t(text.size()));
        bytes_ += text;
        return *this;
    }
    /// Of values without padding.
    template <class T>
    Key& add_all(const std::vector<T>& values) {
        static_assert(std::is_trivially_copyable_v<T> && !std::is_same_v<T, bool>);
        return add(uint64_t(values.size()), hash_of({reinterpret_cast<const char*>(values.data()),
                                                     values.size() * sizeof(T)}));
    }

    const std::string& bytes() const { return bytes_; }

private:
    std::string bytes_;
};

/// Puts values one after the other; those of structs without padding.
class Writer {
public:
    template <class T>
    void put(const T& value) {
        static_assert(std::is_trivially_copyable_v<T>);
        bytes_.append(reinterpret_cast<const char*>(&value), sizeof value);
    }
    template <class T>
    void put(const std::vector<T>& values) {
        static_assert(std::is_trivially_copyable_v<T> && !std::is_same_v<T, bool>);
        put(uint64_t(values.size()));
        bytes_.append(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T));
    }
    const std::string& bytes() const { return bytes_; }

private:
    std::string bytes_;
};

/// Takes them again, from bytes that anybody may have written: any bits have to be a value of T.
class Reader {
public:
    explicit Reader(std::string_view bytes) : left_(bytes) {}

    /// False where there is less left than that.
    template <class T>
    bool get(T& value) {
        static_assert(std::is_trivially_copyable_v<T> && !std::is_same_v<T, bool>);
        if (left_.size() < sizeof value)
            return false;
        std::memcpy(&value, left_.data(), sizeof value);
        left_.remove_prefix(sizeof value);
        return true;
    }
    template <class T>
    bool get(std::vector<T>& values) {
        static_assert(std::is_trivially_copyable_v<T> && !std::is_same_v<T, bool>);
        uint64_t count = 0;
        if (!get(count) || count > left_.size() / sizeof(T))
            return false;
        values.resize(size_t(count));
        if (count > 0)
            std::memcpy(static_cast<void*>(values.data()), left_.data(), count * sizeof(T));
        left_.remove_prefix(size_t(count) * sizeof(T));
        return true;
    }
    bool at_end() const { return left_.empty(); }

private:
    std::string_view left_;
};

/// Stages are handed a pointer to it: null, and they make all themselves. Used by one thread.
class Cache {
public:
    virtual ~Cache() = default;

    /// What all that follows is made of, as well.
    void set_world(const Key& world) { world_ = world.bytes(); }
    /// Of a stage's value; its other inputs are to be added.
    Key key(std::string_view stage) const;

    /// True where a value is kept under the key and `read` takes all of it; what it refuses is told
    /// in notes().
    bool get(const Key& key, const std::function<bool(Reader&)>& read);
    /// Keeps what was made instead.
    void put(const Key& key, const std::function<void(Writer&)>& write);

    /// How many values were there, and how many had to be made.
    struct Counts {
        uint64_t reused = 0, made = 0;
    };
    const Counts& counts() const { return counts_; }
    /// What went wrong since, a line each.
    std::vector<std::string> take_notes() { return std::exchange(notes_, {}); }

protected:
    /// The bytes under a key; none where there are none, or no such ones.
    virtual std::optional<std::string> load(const std::string& key) = 0;
    virtual void store(const std::string& key, std::string_view value) = 0;
    /// Where the bytes are that `read` refused.
    virtual std::string place_of(const std::string& key) const = 0;
    void note(std::string text) { notes_.push_back(std::move(text)); }
    /// That a file holds something else than its name says.
    void note_damaged(const std::string& place);

private:
    std::string world_;
    Counts counts_;
    std::vector<std::string> notes_;
};

} // namespace lpvbake::cache
