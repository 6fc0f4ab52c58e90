//! The `evogait` command. Everything is in the library, so that it can be read and tested in parts.

fn main() -> std::process::ExitCode {
    cli::main()
}
