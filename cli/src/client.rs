//! The coordinator as the commands see it: one call each, errors in words.

use crate::error::Error;
use proto::v1::job_service_client::JobServiceClient;
use proto::v1::{self, JobState};
use std::fmt;
use std::time::Duration;
use tonic::transport::{Channel, Endpoint};
use tonic::{Code, Status};

/// Largest answer taken: a report has the samples of every gait and the whole tree.
const MAX_ANSWER: usize = 1 << 30;
/// How long to wait for a connection.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(10);
/// Jobs asked for at once when listing.
const PAGE: u32 = 200;

/// The address of a coordinator: `http://HOST:PORT`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Url(String);

impl Url {
    /// Checks an address; `from` says in the message where it was given.
    pub fn parse(text: &str, from: &str) -> Result<Self, Error> {
        let wrong = |why: &str| {
            Err(Error::Usage { message: format!("{from} = \"{text}\" is not the address of a coordinator: {why}") })
        };
        if text.starts_with("https://") {
            return wrong("https is not supported yet, use http://HOST:PORT");
        }
        let Some(authority) = text.strip_prefix("http://") else {
            return wrong("it must look like http://HOST:PORT");
        };
        let authority = authority.trim_end_matches('/');
        let port = authority.rsplit_once(':').map(|(_, port)| port.parse::<u16>());
        if !matches!(port, Some(Ok(_))) || Endpoint::from_shared(text.to_owned()).is_err() {
            return wrong("it must look like http://HOST:PORT");
        }
        Ok(Self(format!("http://{authority}")))
    }

    /// The address of a socket of this machine.
    pub fn of_socket(address: std::net::SocketAddr) -> Self {
        Self(format!("http://{address}"))
    }
}

impl fmt::Display for Url {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

/// A connection to a coordinator. Clones share it.
#[derive(Clone)]
pub struct Client {
    url: Url,
    service: JobServiceClient<Channel>,
}

impl Client {
    /// Connects, or says that nobody is there.
    pub async fn connect(url: &Url) -> Result<Self, Error> {
        let unreachable =
            |error: tonic::transport::Error| Error::Unreachable { url: url.to_string(), reason: innermost(&error) };
        let endpoint = Endpoint::from_shared(url.to_string()).map_err(unreachable)?;
        let channel = endpoint
            .connect_timeout(CONNECT_TIMEOUT)
            .http2_keep_alive_interval(Duration::from_secs(20))
            .keep_alive_while_idle(true)
            .connect()
            .await
            .map_err(unreachable)?;
        let service = JobServiceClient::new(channel).max_decoding_message_size(MAX_ANSWER);
        Ok(Self { url: url.clone(), service })
    }

    /// Where it is.
    pub fn url(&self) -> &Url {
        &self.url
    }

    /// Hands a job in; tells also whether it is new to the coordinator.
    pub async fn submit(&mut self, request: v1::SubmitJobRequest) -> Result<(v1::Job, bool), Error> {
        let answer = self.service.submit_job(request).await.map_err(|s| self.error(&s, None))?.into_inner();
        Ok((self.present(answer.job)?, answer.created))
    }

    /// A job and its resolved file.
    pub async fn get(&mut self, id: &str) -> Result<(v1::Job, String), Error> {
        self.standing(id).await.map(|(job, job_toml, _)| (job, job_toml))
    }

    /// A job, its resolved file and, unless it has ended, where it stands at this moment.
    pub async fn standing(&mut self, id: &str) -> Result<(v1::Job, String, Option<v1::Standing>), Error> {
        let request = v1::GetJobRequest { id: id.to_owned() };
        let answer = self.service.get_job(request).await.map_err(|s| self.error(&s, Some(id)))?.into_inner();
        Ok((self.present(answer.job)?, answer.job_toml, answer.standing))
    }

    /// Jobs in these states (all if none is given), newest first, at most `limit`.
    pub async fn list(&mut self, states: &[JobState], limit: usize) -> Result<Vec<v1::Job>, Error> {
        let mut jobs = Vec::new();
        let mut page_token = String::new();
        loop {
            let request = v1::ListJobsRequest {
                page_size: PAGE.min(u32::try_from(limit - jobs.len()).unwrap_or(PAGE)),
                page_token,
                states: states.iter().map(|&s| s.into()).collect(),
            };
            let answer = self.service.list_jobs(request).await.map_err(|s| self.error(&s, None))?.into_inner();
            jobs.extend(answer.jobs);
            if answer.next_page_token.is_empty() || jobs.len() >= limit {
                jobs.truncate(limit);
                return Ok(jobs);
            }
            page_token = answer.next_page_token;
        }
    }

    /// The job's events after a sequence number.
    pub async fn watch(&mut self, id: &str, after: u64) -> Result<tonic::Streaming<v1::JobEvent>, Status> {
        let request = v1::WatchJobRequest { id: id.to_owned(), after };
        Ok(self.service.watch_job(request).await?.into_inner())
    }

    /// Ends a job for good.
    pub async fn cancel(&mut self, id: &str) -> Result<v1::Job, Error> {
        let request = v1::CancelJobRequest { id: id.to_owned() };
        let answer = self.service.cancel_job(request).await.map_err(|s| self.error(&s, Some(id)))?.into_inner();
        self.present(answer.job)
    }

    /// Hands out nothing more of a job.
    pub async fn pause(&mut self, id: &str) -> Result<v1::Job, Error> {
        let request = v1::PauseJobRequest { id: id.to_owned() };
        let answer = self.service.pause_job(request).await.map_err(|s| self.error(&s, Some(id)))?.into_inner();
        self.present(answer.job)
    }

    /// Goes on with a paused job.
    pub async fn resume(&mut self, id: &str) -> Result<v1::Job, Error> {
        let request = v1::ResumeJobRequest { id: id.to_owned() };
        let answer = self.service.resume_job(request).await.map_err(|s| self.error(&s, Some(id)))?.into_inner();
        self.present(answer.job)
    }

    /// Does an ended job again; tells also whether that is new to the coordinator.
    pub async fn restart(&mut self, request: v1::RestartJobRequest) -> Result<(v1::Job, bool), Error> {
        let id = request.id.clone();
        let answer = self.service.restart_job(request).await.map_err(|s| self.error(&s, Some(&id)))?.into_inner();
        Ok((self.present(answer.job)?, answer.created))
    }

    /// What a succeeded job found.
    pub async fn result(&mut self, id: &str) -> Result<v1::GetResultResponse, Error> {
        let request = v1::GetResultRequest { id: id.to_owned() };
        Ok(self.service.get_result(request).await.map_err(|s| self.error(&s, Some(id)))?.into_inner())
    }

    /// The workers that are connected now.
    pub async fn workers(&mut self) -> Result<Vec<v1::WorkerInfo>, Error> {
        let answer = self.service.list_workers(v1::ListWorkersRequest {}).await.map_err(|s| self.error(&s, None))?;
        Ok(answer.into_inner().workers)
    }

    /// An error of the coordinator in words; `id` is the job it is about.
    pub fn error(&self, status: &Status, id: Option<&str>) -> Error {
        let url = self.url.to_string();
        match (status.code(), id) {
            (Code::NotFound, Some(id)) => Error::NoSuchJob { url, id: id.to_owned() },
            _ if is_connection(status) => Error::Unreachable { url, reason: reason(status) },
            _ => Error::Refused { url, reason: reason(status) },
        }
    }

    fn present(&self, job: Option<v1::Job>) -> Result<v1::Job, Error> {
        job.ok_or_else(|| Error::Answer { url: self.url.to_string(), reason: "an answer without a job".to_owned() })
    }
}

/// Whether an error is about the connection, so that trying again later may help.
pub fn is_connection(status: &Status) -> bool {
    use std::error::Error as _;
    matches!(status.code(), Code::Unavailable | Code::Aborted | Code::DeadlineExceeded)
        || (matches!(status.code(), Code::Unknown | Code::Internal | Code::Cancelled) && status.source().is_some())
}

fn reason(status: &Status) -> String {
    use std::error::Error as _;
    match status.source() {
        Some(source) => innermost(source),
        None if status.message().is_empty() => status.code().description().to_owned(),
        None => status.message().to_owned(),
    }
}

/// The cause at the bottom of an error's chain, which is the one that helps.
fn innermost(error: &dyn std::error::Error) -> String {
    let mut cause = error;
    while let Some(source) = cause.source() {
        cause = source;
    }
    let text = cause.to_string();
    text.find(" (os error").map_or(text.clone(), |end| text[..end].to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_have_a_scheme_and_a_port() {
        assert_eq!(Url::parse("http://127.0.0.1:7077/", "x").unwrap().to_string(), "http://127.0.0.1:7077");
        assert!(Url::parse("http://[::1]:7077", "x").is_ok());
        for wrong in ["", "127.0.0.1:7077", "http://host", "http://host:port", "https://host:1", "http://a b:1"] {
            assert!(matches!(Url::parse(wrong, "x"), Err(Error::Usage { .. })), "{wrong}");
        }
    }
}
