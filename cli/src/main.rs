//! The `evogait` command. All code is in the library, so that its parts can be tested.

fn main() -> std::process::ExitCode {
    cli::main()
}
