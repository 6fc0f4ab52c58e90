//! Client of the coordinator's job service: a method for each call, with errors in plain words.

use crate::error::Error;
use proto::credentials::Credentials;
use proto::dial::{Addresses, Backoff, Dial, FailoverChannel, reason};
use proto::limits::MAX_ANSWER;
use proto::v1::job_service_client::JobServiceClient;
use proto::v1::{self, JobState};
use std::fmt;
use std::time::{Duration, Instant};
use tonic::{Code, Response, Status};
use tonic_health::pb::HealthCheckRequest;
use tonic_health::pb::health_check_response::ServingStatus;
use tonic_health::pb::health_client::HealthClient;

/// Limit on the search for a serving coordinator where several addresses are given. A standby takes over within seconds
/// after the serving coordinator has failed.
const FIND_WITHIN: Duration = Duration::from_secs(20);
/// Jobs requested per page of a list.
const PAGE: u32 = 200;

/// Addresses of a coordinator and its standbys, with the credentials for them.
#[derive(Clone, Debug)]
pub struct Url(Dial);

impl Url {
    /// Checks addresses and credentials. `from` is the source of the addresses, for the error message.
    pub fn parse(text: &str, from: &str, credentials: &Credentials) -> Result<Self, Error> {
        let wrong = |why: String| Error::Usage { message: format!("{from}: {why}") };
        let addresses: Addresses = text.parse().map_err(|e: proto::dial::BadAddress| wrong(e.to_string()))?;
        Dial::new(addresses, credentials).map(Self).map_err(|e| wrong(e.to_string()))
    }

    /// Returns a channel with connections of its own.
    pub fn channel(&self) -> FailoverChannel {
        self.0.channel()
    }

    /// Returns the URL of a socket on this machine.
    pub fn of_socket(address: std::net::SocketAddr) -> Self {
        let dial = Dial::new(address.into(), &Credentials::default());
        Self(dial.expect("a URL without TLS and token is valid"))
    }
}

impl fmt::Display for Url {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.addresses().fmt(f)
    }
}

/// Connection to a coordinator. Clones share it.
#[derive(Clone)]
pub struct Client {
    url: Url,
    service: JobServiceClient<FailoverChannel>,
}

impl Client {
    /// Connects to the coordinator; fails if none answers.
    pub async fn connect(url: &Url) -> Result<Self, Error> {
        url.0.reach().await.map_err(|error| Error::Unreachable { url: url.to_string(), reason: reason(&error) })?;
        let service = JobServiceClient::new(url.0.channel()).max_decoding_message_size(MAX_ANSWER);
        Ok(Self { url: url.clone(), service })
    }

    /// Makes a call. With several coordinators, it repeats the call until one of them serves. All calls are safe to
    /// repeat.
    async fn call<M: Clone, T, F: Future<Output = Result<Response<T>, Status>>>(
        &self,
        id: Option<&str>,
        message: M,
        method: impl Fn(JobServiceClient<FailoverChannel>, M) -> F,
    ) -> Result<T, Error> {
        let (mut lost, mut backoff) = (None, Backoff::new());
        loop {
            match method(self.service.clone(), message.clone()).await {
                Ok(answer) => return Ok(answer.into_inner()),
                Err(status) => {
                    let elsewhere = self.url.0.count() > 1 && is_connection(&status);
                    // It takes a while to detect that a coordinator does not answer: the time counts from then.
                    if !elsewhere || lost.get_or_insert_with(Instant::now).elapsed() > FIND_WITHIN {
                        return Err(self.error(&status, id));
                    }
                }
            }
            backoff.wait().await;
        }
    }

    /// Address of the coordinator.
    pub fn url(&self) -> &Url {
        &self.url
    }

    /// Submits a job; also returns true if the job is new to the coordinator.
    pub async fn submit(&mut self, request: v1::SubmitJobRequest) -> Result<(v1::Job, bool), Error> {
        let answer = self.call(None, request, |mut s, r| async move { s.submit_job(r).await }).await?;
        Ok((self.present(answer.job)?, answer.created))
    }

    /// Returns a job and its resolved file.
    pub async fn get(&mut self, id: &str) -> Result<(v1::Job, String), Error> {
        self.standing(id).await.map(|(job, job_toml, _)| (job, job_toml))
    }

    /// Returns a job, its resolved file and, unless the job has ended, its current leases, queue and pace.
    pub async fn standing(&mut self, id: &str) -> Result<(v1::Job, String, Option<v1::Standing>), Error> {
        let request = v1::GetJobRequest { id: id.to_owned() };
        let answer = self.call(Some(id), request, |mut s, r| async move { s.get_job(r).await }).await?;
        Ok((self.present(answer.job)?, answer.job_toml, answer.standing))
    }

    /// Returns at most `limit` jobs in these states (in any state if `states` is empty), newest first.
    pub async fn list(&mut self, states: &[JobState], limit: usize) -> Result<Vec<v1::Job>, Error> {
        let mut jobs = Vec::new();
        let mut page_token = String::new();
        loop {
            let request = v1::ListJobsRequest {
                page_size: PAGE.min(u32::try_from(limit - jobs.len()).unwrap_or(PAGE)),
                page_token,
                states: states.iter().map(|&s| s.into()).collect(),
            };
            let answer = self.call(None, request, |mut s, r| async move { s.list_jobs(r).await }).await?;
            jobs.extend(answer.jobs);
            if answer.next_page_token.is_empty() || jobs.len() >= limit {
                jobs.truncate(limit);
                return Ok(jobs);
            }
            page_token = answer.next_page_token;
        }
    }

    /// Streams the job's events after a sequence number.
    pub async fn watch(&mut self, id: &str, after: u64) -> Result<tonic::Streaming<v1::JobEvent>, Status> {
        let request = v1::WatchJobRequest { id: id.to_owned(), after };
        Ok(self.service.watch_job(request).await?.into_inner())
    }

    /// Cancels a job.
    pub async fn cancel(&mut self, id: &str) -> Result<v1::Job, Error> {
        let request = v1::CancelJobRequest { id: id.to_owned() };
        let answer = self.call(Some(id), request, |mut s, r| async move { s.cancel_job(r).await }).await?;
        self.present(answer.job)
    }

    /// Pauses a job: the coordinator leases no more of its tasks.
    pub async fn pause(&mut self, id: &str) -> Result<v1::Job, Error> {
        let request = v1::PauseJobRequest { id: id.to_owned() };
        let answer = self.call(Some(id), request, |mut s, r| async move { s.pause_job(r).await }).await?;
        self.present(answer.job)
    }

    /// Resumes a paused job.
    pub async fn resume(&mut self, id: &str) -> Result<v1::Job, Error> {
        let request = v1::ResumeJobRequest { id: id.to_owned() };
        let answer = self.call(Some(id), request, |mut s, r| async move { s.resume_job(r).await }).await?;
        self.present(answer.job)
    }

    /// Restarts an ended job; also returns true if the restart is new to the coordinator.
    pub async fn restart(&mut self, request: v1::RestartJobRequest) -> Result<(v1::Job, bool), Error> {
        let id = request.id.clone();
        let answer = self.call(Some(&id), request, |mut s, r| async move { s.restart_job(r).await }).await?;
        Ok((self.present(answer.job)?, answer.created))
    }

    /// Returns the result of a succeeded job.
    pub async fn result(&mut self, id: &str) -> Result<v1::GetResultResponse, Error> {
        let request = v1::GetResultRequest { id: id.to_owned() };
        self.call(Some(id), request, |mut s, r| async move { s.get_result(r).await }).await
    }

    /// Returns the workers that are connected now.
    pub async fn workers(&mut self) -> Result<Vec<v1::WorkerInfo>, Error> {
        let request = v1::ListWorkersRequest {};
        Ok(self.call(None, request, |mut s, r| async move { s.list_workers(r).await }).await?.workers)
    }

    /// Returns the number of slots that the jobs could use, and the number of slots present.
    pub async fn demand(&mut self) -> Result<v1::GetDemandResponse, Error> {
        self.call(None, v1::GetDemandRequest {}, |mut s, r| async move { s.get_demand(r).await }).await
    }

    /// Returns true if the coordinator reports that it serves clients. A standby answers, but does not serve.
    pub async fn serving(&mut self) -> Result<bool, Error> {
        let service =
            <proto::v1::job_service_server::JobServiceServer<()> as tonic::server::NamedService>::NAME.to_owned();
        let request = HealthCheckRequest { service };
        let answer = HealthClient::new(self.url.0.channel()).check(request).await.map_err(|s| self.error(&s, None))?;
        Ok(answer.into_inner().status() == ServingStatus::Serving)
    }

    /// Converts a gRPC status to an error; `id` is the job of the call.
    pub fn error(&self, status: &Status, id: Option<&str>) -> Error {
        let url = self.url.to_string();
        match (status.code(), id) {
            (Code::NotFound, Some(id)) => Error::NoSuchJob { url, id: id.to_owned() },
            (Code::AlreadyExists, None) => {
                let why = "it already has this job with another name, description or priority";
                let reason = format!("{why}: `evogait submit --again` submits it as a new job ({})", words(status));
                Error::Refused { url, reason }
            }
            _ if is_connection(status) => Error::Unreachable { url, reason: words(status) },
            _ => Error::Refused { url, reason: words(status) },
        }
    }

    fn present(&self, job: Option<v1::Job>) -> Result<v1::Job, Error> {
        job.ok_or_else(|| Error::Answer { url: self.url.to_string(), reason: "the answer has no job".to_owned() })
    }
}

/// Returns true for an error of the connection, where a later retry may succeed.
pub fn is_connection(status: &Status) -> bool {
    use std::error::Error as _;
    matches!(status.code(), Code::Unavailable | Code::Aborted | Code::DeadlineExceeded)
        || (matches!(status.code(), Code::Unknown | Code::Internal | Code::Cancelled) && status.source().is_some())
}

fn words(status: &Status) -> String {
    use std::error::Error as _;
    match status.source() {
        Some(source) => reason(source),
        None if status.message().is_empty() => status.code().description().to_owned(),
        None => status.message().to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn invalid_address_is_usage_error_with_its_source() {
        let none = Credentials::default();
        assert_eq!(Url::parse("http://127.0.0.1:7077/", "x", &none).unwrap().to_string(), "http://127.0.0.1:7077");
        for wrong in ["", "127.0.0.1:7077", "http://host", "https://host:1"] {
            let Err(Error::Usage { message }) = Url::parse(wrong, "--coordinator", &none) else { panic!("{wrong}") };
            assert!(message.starts_with("--coordinator: "), "{message}");
        }
    }
}
