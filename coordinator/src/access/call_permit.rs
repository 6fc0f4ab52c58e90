//! Permission of a call while it lasts: a stream ends when its token is revoked.

use super::judge;
use super::rules::Rule;
use super::tokens::{TokenDigest, Tokens};
use sim_core::base::digest::Digest;
use std::future::pending;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll, ready};
use tokio_stream::Stream;
use tonic::{Extensions, Status};

/// Permission of a call. A call without a token, on a coordinator that requires none, stays permitted.
#[derive(Clone, Default)]
pub(crate) struct CallPermit(Option<Held>);

#[derive(Clone)]
struct Held {
    token: TokenDigest,
    rule: Rule,
    path: Arc<str>,
    tokens: Tokens,
}

impl CallPermit {
    pub(super) fn new(token: TokenDigest, rule: Rule, path: &str, tokens: Tokens) -> Self {
        Self(Some(Held { token, rule, path: path.into(), tokens }))
    }

    /// Returns the permission of a request.
    pub fn of(extensions: &Extensions) -> Self {
        extensions.get::<Self>().cloned().unwrap_or_default()
    }

    /// Returns the first digits of the token's digest; empty if no token is required.
    pub fn credential(&self) -> Arc<str> {
        self.0.as_ref().map(|held| Digest(held.token).short().into()).unwrap_or_default()
    }

    /// Returns an error once the token no longer permits the call. [`Self::ended`] returns the same error a moment
    /// later.
    pub fn check(&self) -> Result<(), Status> {
        self.0.as_ref().map_or(Ok(()), Held::check)
    }

    /// Waits until the token no longer permits the call, and returns the error. Never returns without a token.
    pub async fn ended(&mut self) -> Status {
        let Some(held) = &mut self.0 else { return pending().await };
        loop {
            held.tokens.mark_unchanged();
            if let Err(status) = held.check() {
                return status;
            }
            if held.tokens.changed().await.is_err() {
                return pending().await;
            }
        }
    }

    /// Wraps a stream so that it ends with this permission.
    pub fn over<S>(self, stream: S) -> Passing<S> {
        let mut waiting = self.clone();
        Passing { stream, pass: self, ended: Some(Box::pin(async move { waiting.ended().await })) }
    }
}

impl Held {
    fn check(&self) -> Result<(), Status> {
        judge(self.tokens.borrow().get(&self.token).copied(), self.rule, &self.path)
    }
}

/// Stream that ends with an error when its [`CallPermit`] does.
pub(crate) struct Passing<S> {
    stream: S,
    pass: CallPermit,
    /// `None` after the end.
    ended: Option<Pin<Box<dyn Future<Output = Status> + Send>>>,
}

impl<S, T> Stream for Passing<S>
where
    S: Stream<Item = Result<T, Status>> + Unpin,
{
    type Item = Result<T, Status>;

    fn poll_next(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Option<Self::Item>> {
        let Some(ended) = &mut self.ended else { return Poll::Ready(None) };
        if let Poll::Ready(status) = ended.as_mut().poll(cx) {
            self.ended = None;
            return Poll::Ready(Some(Err(status)));
        }
        let next = ready!(Pin::new(&mut self.stream).poll_next(cx));
        if next.is_none() {
            self.ended = None;
            // The source of the stream may have ended first because of the same revocation.
            return Poll::Ready(self.pass.check().err().map(Err));
        }
        Poll::Ready(next)
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Access, Caller, admit};
    use super::*;
    use http::HeaderMap;
    use http::header::AUTHORIZATION;
    use std::time::Duration;
    use tokio_stream::StreamExt as _;
    use tonic::Code;

    const OLD: &str = "worker old-token-0123456789\n";
    const NEW: &str = "worker new-token-0123456789\n";

    fn session(access: &Access) -> CallPermit {
        let headers: HeaderMap =
            [(AUTHORIZATION, "Bearer old-token-0123456789".parse().unwrap())].into_iter().collect();
        match admit(Some(access), "/evogait.v1.WorkerService/Session", &headers) {
            Ok(Caller::Holder(pass)) => pass,
            _ => panic!("the token must have role worker"),
        }
    }

    #[tokio::test]
    async fn stream_ends_when_its_token_is_revoked() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let write = |text: String| std::fs::write(file.path(), text).unwrap();
        write(OLD.to_owned());
        let access = Access::read(file.path()).unwrap();
        let (said, heard) = tokio::sync::mpsc::unbounded_channel::<Result<u8, Status>>();
        let mut stream = session(&access).over(tokio_stream::wrappers::UnboundedReceiverStream::new(heard));
        let silent = Duration::from_millis(20);

        // An added token and a file that can't be read leave the stream open.
        write(format!("{OLD}{NEW}"));
        access.reload().unwrap();
        write("worker".to_owned());
        access.reload().unwrap_err();
        assert!(tokio::time::timeout(silent, stream.next()).await.is_err());
        said.send(Ok(7)).unwrap();
        assert_eq!(stream.next().await.unwrap().unwrap(), 7);

        write(NEW.to_owned());
        access.reload().unwrap();
        said.send(Ok(8)).unwrap();
        assert_eq!(stream.next().await.unwrap().unwrap_err().code(), Code::Unauthenticated);
        assert!(stream.next().await.is_none());
    }

    #[tokio::test]
    async fn stream_reports_revocation_if_its_source_ended_first() {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), OLD).unwrap();
        let access = Access::read(file.path()).unwrap();
        let pass = session(&access);
        std::fs::write(file.path(), NEW).unwrap();
        // The source has ended, but the notification has not reached this stream yet.
        let (stream, ended) = (tokio_stream::empty::<Result<u8, Status>>(), Some(Box::pin(pending()) as _));
        let mut stream = Passing { stream, pass, ended };
        access.reload().unwrap();
        assert_eq!(stream.next().await.unwrap().unwrap_err().code(), Code::Unauthenticated);
        assert!(stream.next().await.is_none());
    }

    #[tokio::test]
    async fn changed_role_of_token_ends_the_stream() {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), OLD).unwrap();
        let access = Access::read(file.path()).unwrap();
        let mut pass = session(&access);
        std::fs::write(file.path(), OLD.replace("worker", "client")).unwrap();
        access.reload().unwrap();
        let end = tokio::time::timeout(Duration::from_secs(10), pass.ended()).await;
        assert_eq!(end.expect("the permission ends").code(), Code::PermissionDenied);
    }

    #[tokio::test]
    async fn permission_without_token_never_ends() {
        let mut pass = CallPermit::of(&Extensions::default());
        assert!(tokio::time::timeout(Duration::from_millis(20), pass.ended()).await.is_err());
    }
}
