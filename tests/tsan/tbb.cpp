// What orders the work of TBB, told to ThreadSanitizer.
//
// Debian's libtbb is not instrumented, so that the sanitizer sees neither that a task runs after
// its spawner, nor that who waits goes on after the tasks, and would report each result of a loop
// as a race. These functions stand before the library's of the same name (the executable's come
// first) and add those two edges, and the one of a block of memory that changes hands. No report is
// suppressed for it. What stays hidden: accesses inside libtbb, Embree, OpenVDB and Mesa
// themselves, and a race between two bodies of a loop that happened to run in one thread, or in two
// between which TBB made an edge that it does not promise (a task that was stolen after the other
// ended).
#include <dlfcn.h>
#include <sanitizer/tsan_interface.h>

#include <tbb/task_group.h>

namespace {

namespace d1 = tbb::detail::d1;

template <class Function>
Function* next(const char* symbol) {
    return reinterpret_cast<Function*>(dlsym(RTLD_NEXT, symbol));
}

/// Runs a task in its place, after what its spawner did.
class Ordered final : public d1::task {
public:
    explicit Ordered(d1::task& inner) : task_(inner) { __tsan_release(&inner); }

    task* execute(d1::execution_data& data) override {
        __tsan_acquire(&task_);
        task* const next = task_.execute(data);
        delete this; // not where it throws: then it is cancelled yet
        return next;
    }
    task* cancel(d1::execution_data& data) override {
        __tsan_acquire(&task_);
        task* const next = task_.cancel(data);
        delete this;
        return next;
    }

private:
    ~Ordered() override = default;

    task& task_;
};

/// Who waits goes on after what the tasks did, also where one of them threw: each counts down in
/// the context, by code of TBB's headers, which is instrumented.
class Waiting {
public:
    explicit Waiting(d1::wait_context& context) : context_(context) {}
    ~Waiting() {
        constexpr std::size_t count = sizeof(std::uint64_t); // after a word of version and traits
        static_assert(sizeof(d1::wait_context) == 2 * count);
        __tsan_acquire(reinterpret_cast<char*>(&context_) + count);
    }
    Waiting(const Waiting&) = delete;
    Waiting& operator=(const Waiting&) = delete;

private:
    d1::wait_context& context_;
};

} // namespace

extern "C" const char* __tsan_default_options() {
    return "suppressions=" LPVBAKE_SUPPRESSIONS;
}

namespace tbb::detail::r1 {

void spawn(d1::task& task, d1::task_group_context& group) {
    static auto* const real = next<void(d1::task&, d1::task_group_context&)>(
        "_ZN3tbb6detail2r15spawnERNS0_2d14taskERNS2_18task_group_contextE");
    real(*new Ordered(task), group);
}

void spawn(d1::task& task, d1::task_group_context& group, d1::slot_id slot) {
    static auto* const real = next<void(d1::task&, d1::task_group_context&, d1::slot_id)>(
        "_ZN3tbb6detail2r15spawnERNS0_2d14taskERNS2_18task_group_contextEt");
    real(*new Ordered(task), group, slot);
}

void execute_and_wait(d1::task& task, d1::task_group_context& group, d1::wait_context& wait,
                      d1::task_group_context& waiting_group) {
    static auto* const real =
        next<void(d1::task&, d1::task_group_context&, d1::wait_context&, d1::task_group_context&)>(
            "_ZN3tbb6detail2r116execute_and_waitERNS0_2d14taskERNS2_18task_group_"
            "contextERNS2_12wait_contextES6_");
    const Waiting waiting(wait);
    real(task, group, wait, waiting_group);
}

void wait(d1::wait_context& wait, d1::task_group_context& group) {
    static auto* const real = next<void(d1::wait_context&, d1::task_group_context&)>(
        "_ZN3tbb6detail2r14waitERNS0_2d112wait_contextERNS2_18task_group_contextE");
    const Waiting waiting(wait);
    real(wait, group);
}

// Blocks go back to the pool of the thread that took them, and out again.

void* allocate(d1::small_object_pool*& pool, std::size_t bytes) {
    static auto* const real = next<void*(d1::small_object_pool*&, std::size_t)>(
        "_ZN3tbb6detail2r18allocateERPNS0_2d117small_object_poolEm");
    void* const block = real(pool, bytes);
    __tsan_acquire(block);
    return block;
}

void* allocate(d1::small_object_pool*& pool, std::size_t bytes, const d1::execution_data& data) {
    static auto* const real =
        next<void*(d1::small_object_pool*&, std::size_t, const d1::execution_data&)>(
            "_ZN3tbb6detail2r18allocateERPNS0_2d117small_object_poolEmRKNS2_14execution_dataE");
    void* const block = real(pool, bytes, data);
    __tsan_acquire(block);
    return block;
}

void deallocate(d1::small_object_pool& pool, void* block, std::size_t bytes) {
    static auto* const real = next<void(d1::small_object_pool&, void*, std::size_t)>(
        "_ZN3tbb6detail2r110deallocateERNS0_2d117small_object_poolEPvm");
    __tsan_release(block);
    real(pool, block, bytes);
}

void deallocate(d1::small_object_pool& pool, void* block, std::size_t bytes,
                const d1::execution_data& data) {
    static auto* const real =
        next<void(d1::small_object_pool&, void*, std::size_t, const d1::execution_data&)>(
            "_ZN3tbb6detail2r110deallocateERNS0_2d117small_object_poolEPvmRKNS2_14execution_dataE");
    __tsan_release(block);
    real(pool, block, bytes, data);
}

} // namespace tbb::detail::r1
