//! Channel over several addresses.

use super::Dial;
use std::future::poll_fn;
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::task::{Context, Poll};
use tonic::body::Body;
use tonic::transport::Channel;
use tower_service::Service;

/// Channel to the address that serves. If it does not serve, the call fails with UNAVAILABLE, and the next call uses
/// the next address. Adds the token to each call. Clones share connections.
#[derive(Clone, Debug)]
pub struct FailoverChannel {
    dial: Dial,
    channels: Arc<[Channel]>,
}

impl FailoverChannel {
    pub(super) fn new(dial: &Dial) -> Self {
        let channels = dial.endpoints.iter().map(|endpoint| endpoint.connect_lazy()).collect();
        Self { dial: dial.clone(), channels }
    }

    /// Returns the addresses and credentials.
    pub fn dial(&self) -> &Dial {
        &self.dial
    }
}

impl Service<http::Request<Body>> for FailoverChannel {
    type Response = http::Response<Body>;
    type Error = tonic::transport::Error;
    type Future = Pin<Box<dyn Future<Output = Result<Self::Response, Self::Error>> + Send>>;

    fn poll_ready(&mut self, _: &mut Context<'_>) -> Poll<Result<(), Self::Error>> {
        // `call` selects the channel and waits until it is ready.
        Poll::Ready(Ok(()))
    }

    fn call(&mut self, mut request: http::Request<Body>) -> Self::Future {
        let dial = self.dial.clone();
        let at = dial.current.load(Ordering::Relaxed);
        let mut channel = self.channels[at].clone();
        if let Some(token) = &dial.token {
            request.headers_mut().insert(http::header::AUTHORIZATION, token.clone());
        }
        Box::pin(async move {
            let answer = match poll_fn(|cx| channel.poll_ready(cx)).await {
                Ok(()) => channel.call(request).await,
                Err(error) => Err(error),
            };
            if answer.as_ref().map_or(true, stands_by) {
                dial.leave(at);
            }
            answer
        })
    }
}

/// Returns true if the status of an answer is UNAVAILABLE.
fn stands_by(answer: &http::Response<Body>) -> bool {
    let unavailable = tonic::Code::Unavailable as i32;
    answer.headers().get("grpc-status").is_some_and(|status| status.as_bytes() == unavailable.to_string().as_bytes())
}
