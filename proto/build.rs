//! Compiles the .proto files in pure Rust: no system `protoc` is needed.

use prost::Message as _;
use std::path::PathBuf;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let files = ["evogait/v1/job.proto", "evogait/v1/worker.proto"];
    for file in files {
        println!("cargo:rerun-if-changed={file}");
    }
    let descriptors = protox::compile(files, ["."])?;
    let out = PathBuf::from(std::env::var("OUT_DIR")?);
    let descriptor_path = out.join("evogait.v1.bin");
    std::fs::write(&descriptor_path, descriptors.encode_to_vec())?;
    tonic_prost_build::configure().compile_fds(descriptors)?;
    // KEDA's protocol: not part of the API that gRPC reflection lists.
    println!("cargo:rerun-if-changed=keda/externalscaler.proto");
    tonic_prost_build::configure().compile_fds(protox::compile(["keda/externalscaler.proto"], ["."])?)?;
    Ok(())
}
