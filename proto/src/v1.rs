//! Version 1 of the protocol, generated from `proto/evogait/v1`.
#![allow(missing_docs, clippy::all)]

tonic::include_proto!("evogait.v1");
