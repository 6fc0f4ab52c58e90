//! Layer in front of all services that checks the token of each call.

use super::{Access, Caller, admit};
use crate::listener::Visit;
use crate::log_limit::LogLimit;
use crate::standby::Gate;
use std::future::ready;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};
use tonic::body::Body;
use tower_layer::Layer;
use tower_service::Service;

/// Refuses calls without permission before their body is read. A standby answers that it is a standby before it checks
/// the token: its tokens may be out of date.
pub(crate) fn layer<S>(access: Option<Arc<Access>>, gate: Gate) -> impl Layer<S, Service = Guard<S>> + Clone {
    let told = Arc::new(LogLimit::default());
    tower_layer::layer_fn(move |inner| Guard { inner, access: access.clone(), gate: gate.clone(), told: told.clone() })
}

#[derive(Clone)]
pub(crate) struct Guard<S> {
    inner: S,
    access: Option<Arc<Access>>,
    gate: Gate,
    told: Arc<LogLimit>,
}

impl<S> Service<http::Request<Body>> for Guard<S>
where
    S: Service<http::Request<Body>, Response = http::Response<Body>>,
    S::Future: Send + 'static,
    S::Error: Send + 'static,
{
    type Response = S::Response;
    type Error = S::Error;
    type Future = Pin<Box<dyn Future<Output = Result<Self::Response, Self::Error>> + Send>>;

    fn poll_ready(&mut self, cx: &mut Context<'_>) -> Poll<Result<(), Self::Error>> {
        self.inner.poll_ready(cx)
    }

    fn call(&mut self, mut request: http::Request<Body>) -> Self::Future {
        let visit = Visit::of(request.extensions());
        match admit(self.access.as_deref(), request.uri().path(), request.headers()) {
            Ok(caller) => {
                if caller.is_known()
                    && let Some(visit) = visit
                {
                    visit.is_known();
                }
                if let Caller::Holder(pass) = caller {
                    request.extensions_mut().insert(pass);
                }
                Box::pin(self.inner.call(request))
            }
            Err(status) => {
                if let Some(standby) = self.gate.closed() {
                    return Box::pin(ready(Ok(standby.into_http())));
                }
                // Rate-limited, so that unauthenticated peers can't fill the log.
                if let Some(others) = self.told.now() {
                    let peer = visit.map(|v| v.peer().to_string()).unwrap_or_default();
                    tracing::warn!(peer, reason = status.message(), others, "call refused");
                }
                Box::pin(ready(Ok(status.into_http())))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::convert::Infallible;
    use tonic::Code;

    #[tokio::test]
    async fn standby_does_not_check_tokens() {
        let access = Access::parse("worker worker-token-0123456\n").unwrap();
        let (key, gate) = Gate::new(false);
        let inside = tower::service_fn(|_| async { Ok::<_, Infallible>(http::Response::new(Body::empty())) });
        let mut guard = layer(Some(Arc::new(access)), gate).layer(inside);
        let mut code = async |token: &str| {
            let request = http::Request::post("/evogait.v1.WorkerService/Session");
            let request = request.header(http::header::AUTHORIZATION, format!("Bearer {token}"));
            let answer = guard.call(request.body(Body::empty()).unwrap()).await.unwrap();
            tonic::Status::from_header_map(answer.headers()).map_or(Code::Ok, |status| status.code())
        };
        // The token may be newer than the tokens of this standby.
        assert_eq!(code("worker-token-0123457").await, Code::Unavailable);
        key.open();
        assert_eq!(code("worker-token-0123457").await, Code::Unauthenticated);
        assert_eq!(code("worker-token-0123456").await, Code::Ok);
    }
}
