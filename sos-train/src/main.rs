//! The program `sos`.

// Training allocates and frees large tensors all the time, from several threads.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

fn main() -> std::process::ExitCode {
    sos_train::memory::keep_freed_memory();
    sos_train::cli::run()
}
