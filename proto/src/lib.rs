//! The wire: messages of clients, coordinator and workers; the only place where wire types become sim-core types and
//! back; and the way to a coordinator: addresses, certificates and tokens.

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

/// The compiled descriptors, for gRPC reflection.
pub const DESCRIPTORS: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/evogait.v1.bin"));

/// Version of the worker protocol: both sides of a session must have the same.
pub const PROTOCOL: u32 = 3;
