//! Wire protocol: messages of clients, coordinator and workers; conversions between wire types and sim-core types,
//! which exist only here; and connections to a coordinator: addresses, certificates and tokens.

mod convert;
pub mod credentials;
pub mod dial;
pub mod limits;

pub use convert::{ConvertError, digest};

pub mod v1;

/// KEDA's calls to an external scaler, generated from `proto/keda`.
#[allow(missing_docs, clippy::all)]
pub mod externalscaler {
    tonic::include_proto!("externalscaler");
}

/// Compiled descriptors of the protocol, for gRPC reflection.
pub const DESCRIPTORS: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/evogait.v1.bin"));

/// Version of the worker protocol: a session requires the same version on both sides.
pub const PROTOCOL: u32 = 3;
