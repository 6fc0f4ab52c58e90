//! JobService: calls of clients.

use super::{Api, at_most, id, no_nul, store_failed};
use crate::access::{CallPermit, Passing};
use crate::actor::{Command, SubmitError};
use crate::convert;
use crate::limits::{MAX_ACTIVE_JOBS, MAX_STATES, PACE_OVER};
use crate::record::{Event, JobId, JobRecord, JobState};
use crate::scheduler::{Demand, NewJob};
use crate::store::StoredEvent;
use proto::limits::{DEFAULT_PAGE, DEFAULT_PRIORITY, MAX_JOB_TOML, MAX_PAGE, MAX_PRIORITY, MAX_REQUEST_ID};
use proto::v1::job_service_server::JobService;
use proto::v1::{
    CancelJobRequest, CancelJobResponse, GetDemandRequest, GetDemandResponse, GetJobRequest, GetJobResponse,
    GetResultRequest, GetResultResponse, Job, JobEvent, ListJobsRequest, ListJobsResponse, ListWorkersRequest,
    ListWorkersResponse, PauseJobRequest, PauseJobResponse, RestartJobRequest, RestartJobResponse, ResumeJobRequest,
    ResumeJobResponse, SubmitJobRequest, SubmitJobResponse, WatchJobRequest,
};
use sim_core::base::digest::Digest;
use sim_core::base::statistics::median;
use sim_core::problem::Checked;
use sim_core::procedure;
use tokio_stream::wrappers::ReceiverStream;
use tonic::{Request, Response, Status};

impl Api {
    pub(super) async fn stored(&self, text: &str) -> Result<(JobRecord, String), Status> {
        id("id", text)?;
        let job = self.store.job(&JobId::from(text)).await.map_err(store_failed)?;
        job.ok_or_else(|| Status::not_found(format!("there is no job {text}")))
    }

    /// Converts job records for the API and adds the progress of the current round and the reason for waiting.
    async fn tell(&self, records: Vec<JobRecord>) -> Result<Vec<Job>, Status> {
        let active: Vec<JobId> = records.iter().filter(|r| !r.state.is_end()).map(|r| r.id.clone()).collect();
        let mut standings = Vec::new();
        if !active.is_empty() {
            standings = self.ask(|reply| Command::Standing { ids: active, reply }).await?;
        }
        let mut standings = standings.into_iter();
        let mut jobs = Vec::with_capacity(records.len());
        for record in records {
            let standing = if record.state.is_end() { None } else { standings.next() };
            let Some(standing) = standing else {
                jobs.push(convert::job(&record));
                continue;
            };
            // The record that was read before may be a round older than this progress: both must be of one moment.
            let now = match standing.record {
                Some(record) => Some(record),
                None => self.store.job(&record.id).await.map_err(store_failed)?.map(|(record, _)| record),
            };
            let mut job = convert::job(&now.unwrap_or(record));
            if let Some(round) = standing.round {
                job.reason = standing.waits_for.unwrap_or_default();
                (job.tasks_done, job.tasks_total) = round;
            }
            jobs.push(job);
        }
        Ok(jobs)
    }

    /// Returns the median time between the seals of successive rounds, over the newest rounds, ms; 0 with fewer than
    /// two. A pause or a restart affects one of many values.
    async fn pace(&self, id: &JobId, last_event: u64) -> Result<f64, Status> {
        let after = last_event.saturating_sub(u64::from(PACE_OVER) + 1);
        let events = self.store.events(id, after, PACE_OVER + 1).await.map_err(store_failed)?;
        let sealed = |e: &&StoredEvent| matches!(e.event.event, Event::Sealed { .. });
        let seals: Vec<i64> = events.iter().filter(sealed).map(|e| e.event.at_ms).collect();
        let times: Vec<f64> = seals.windows(2).map(|w| (w[1] - w[0]).max(0) as f64).collect();
        Ok(median(&times).unwrap_or(0.0))
    }

    /// Returns the job of an earlier request with this id, or an error if that request had another body.
    pub(super) async fn requested_before(&self, id: &str, digest: &Digest) -> Result<Option<JobRecord>, Status> {
        match self.store.job_of_request(id).await.map_err(store_failed)? {
            Some(record) if record.request_digest != *digest => Err(other_body(id, &record.id)),
            known => Ok(known),
        }
    }

    /// Reads a job while it holds a permit. The permit is held to the end of reading, even if the client disconnects.
    pub(super) async fn reading(
        &self,
        read: impl FnOnce() -> Result<NewJob, Status> + Send + 'static,
    ) -> Result<NewJob, Status> {
        let place = self.gates.readings.wait().await;
        let reading = tokio::task::spawn_blocking(move || {
            let _place = place;
            read()
        });
        let failed = |_| Status::internal("reading the job failed; this is a bug: please report it with the job file");
        reading.await.map_err(failed)?
    }

    /// Stores a new job. Returns its record, and true if the job did not exist before.
    pub(super) async fn take_in(&self, new: NewJob) -> Result<(JobRecord, bool), Status> {
        let request_id = new.request_id.clone();
        self.ask(|reply| Command::Submit { new: Box::new(new), reply }).await?.map_err(|refused| match refused {
            SubmitError::OtherBody(job) => other_body(&request_id, &job),
            SubmitError::TooMany => Status::resource_exhausted(format!(
                "{MAX_ACTIVE_JOBS} jobs are active, which is the limit: wait for one to end, or cancel one"
            )),
        })
    }

    async fn pause(&self, text: String, paused: bool) -> Result<Option<Job>, Status> {
        id("id", &text)?;
        let id = JobId::from(text.as_str());
        match self.ask(|reply| Command::Pause { id, paused, reply }).await? {
            Some(record) => self.tell_one(record).await,
            None => {
                let (record, _) = self.stored(&text).await?;
                let what = if paused { "paused" } else { "resumed" };
                Err(Status::failed_precondition(format!(
                    "job {} has ended ({}): only an active job can be {what}",
                    record.id,
                    record.state.word()
                )))
            }
        }
    }

    async fn tell_one(&self, record: JobRecord) -> Result<Option<Job>, Status> {
        Ok(self.tell(vec![record]).await?.pop())
    }
}

/// Checks a request id.
pub(super) fn request_id(request_id: &str) -> Result<(), Status> {
    if request_id.is_empty() {
        return Err(Status::invalid_argument(format!(
            "request_id is missing: choose one of 1 to {MAX_REQUEST_ID} bytes; it makes a retry safe"
        )));
    }
    no_nul("request_id", request_id)?;
    at_most("request_id", request_id, MAX_REQUEST_ID)
}

/// Parses and validates the job and prepares its data for the scheduler. Nothing is simulated.
pub(super) fn read(request: SubmitJobRequest, priority: u32, request_digest: Digest) -> Result<NewJob, Status> {
    let unusable = |e| Status::invalid_argument(format!("the job can't be used: {e}"));
    let job = Checked::from_toml(&request.job_toml).map_err(unusable)?;
    Ok(NewJob {
        name: job.spec().name.clone(),
        request_id: request.request_id,
        request_digest,
        priority,
        job_digest: job.digest(),
        engine_digest: job.engine_digest(),
        kind: procedure::name(&job).map_err(unusable)?.to_owned(),
        procedure: procedure::start(&job).map_err(unusable)?,
        carried: None,
        // Resolved: workers need no files, and a later version's defaults do not apply.
        toml: job.to_toml().into(),
    })
}

/// Refuses a repeated request if its priority differs from that of the job of its request id.
fn same_priority(request_id: &str, record: &JobRecord, asked: Option<u32>) -> Result<(), Status> {
    match asked.filter(|priority| *priority != record.priority) {
        Some(_) => Err(other_body(request_id, &record.id)),
        None => Ok(()),
    }
}

fn other_body(request_id: &str, job: &JobId) -> Status {
    Status::already_exists(format!(
        "request_id '{request_id}' was used for job {job} with another text or priority: choose a new request_id"
    ))
}

#[tonic::async_trait]
impl JobService for Api {
    type WatchJobStream = Passing<ReceiverStream<Result<JobEvent, Status>>>;

    async fn submit_job(&self, request: Request<SubmitJobRequest>) -> Result<Response<SubmitJobResponse>, Status> {
        let request = request.into_inner();
        request_id(&request.request_id)?;
        at_most("job_toml", &request.job_toml, MAX_JOB_TOML)?;
        let priority = match request.priority {
            0 => DEFAULT_PRIORITY,
            priority @ 1..=MAX_PRIORITY => priority,
            priority => {
                return Err(Status::invalid_argument(format!(
                    "priority {priority} is out of range: 1 to {MAX_PRIORITY} are allowed"
                )));
            }
        };
        let request_digest = Digest::of("evogait request 1", &request.job_toml);
        if let Some(record) = self.requested_before(&request.request_id, &request_digest).await? {
            same_priority(&request.request_id, &record, (request.priority > 0).then_some(priority))?;
            return Ok(Response::new(SubmitJobResponse { job: self.tell_one(record).await?, created: false }));
        }
        let asked = (request.priority > 0).then_some(priority);
        let new = self.reading(move || read(request, priority, request_digest)).await?;
        let request_id = new.request_id.clone();
        let (record, created) = self.take_in(new).await?;
        same_priority(&request_id, &record, asked)?;
        Ok(Response::new(SubmitJobResponse { job: self.tell_one(record).await?, created }))
    }

    async fn get_job(&self, request: Request<GetJobRequest>) -> Result<Response<GetJobResponse>, Status> {
        let (record, job_toml) = self.stored(&request.into_inner().id).await?;
        let (id, last_event) = (record.id.clone(), record.last_event);
        let mut standing = None;
        if !record.state.is_end() {
            standing = self.ask(|reply| Command::Detail { id: id.clone(), reply }).await?.map(convert::standing);
        }
        if let Some(standing) = &mut standing {
            standing.round_ms = self.pace(&id, last_event).await?;
        }
        Ok(Response::new(GetJobResponse { job: self.tell_one(record).await?, job_toml, standing }))
    }

    async fn list_jobs(&self, request: Request<ListJobsRequest>) -> Result<Response<ListJobsResponse>, Status> {
        let request = request.into_inner();
        let size = match request.page_size {
            0 => DEFAULT_PAGE,
            size @ 1..=MAX_PAGE => size,
            size => {
                return Err(Status::invalid_argument(format!(
                    "page_size {size} is out of range: 1 to {MAX_PAGE} are allowed"
                )));
            }
        };
        let below = match request.page_token.as_str() {
            "" => u64::MAX,
            token => token.parse().map_err(|_| {
                Status::invalid_argument("page_token is not from an earlier response: leave it empty to start")
            })?,
        };
        if request.states.len() > MAX_STATES {
            return Err(Status::invalid_argument(format!(
                "the request has {} states: at most {MAX_STATES} are allowed",
                request.states.len()
            )));
        }
        let states: Vec<JobState> = request.states().filter_map(convert::asked_state).collect();
        let mut records = self.store.jobs(below, size + 1, &states).await.map_err(store_failed)?;
        let more = records.len() > size as usize;
        records.truncate(size as usize);
        let next_page_token = records.last().filter(|_| more).map(|r| r.number.to_string()).unwrap_or_default();
        Ok(Response::new(ListJobsResponse { jobs: self.tell(records).await?, next_page_token }))
    }

    async fn watch_job(&self, request: Request<WatchJobRequest>) -> Result<Response<Self::WatchJobStream>, Status> {
        let pass = CallPermit::of(request.extensions());
        let WatchJobRequest { id, after } = request.into_inner();
        let (record, _) = self.stored(&id).await?;
        if after > record.last_event {
            return Err(Status::out_of_range(format!(
                "after = {after} is out of range: the newest event of job {id} is {}",
                record.last_event
            )));
        }
        Ok(Response::new(pass.over(self.watch(record.id, after, self.gates.watchers.pass()?))))
    }

    async fn cancel_job(&self, request: Request<CancelJobRequest>) -> Result<Response<CancelJobResponse>, Status> {
        let text = request.into_inner().id;
        id("id", &text)?;
        let job = JobId::from(text.as_str());
        let record = match self.ask(|reply| Command::Cancel { id: job, reply }).await? {
            Some(record) => record,
            None => self.stored(&text).await?.0,
        };
        Ok(Response::new(CancelJobResponse { job: Some(convert::job(&record)) }))
    }

    async fn pause_job(&self, request: Request<PauseJobRequest>) -> Result<Response<PauseJobResponse>, Status> {
        let job = self.pause(request.into_inner().id, true).await?;
        Ok(Response::new(PauseJobResponse { job }))
    }

    async fn resume_job(&self, request: Request<ResumeJobRequest>) -> Result<Response<ResumeJobResponse>, Status> {
        let job = self.pause(request.into_inner().id, false).await?;
        Ok(Response::new(ResumeJobResponse { job }))
    }

    async fn restart_job(&self, request: Request<RestartJobRequest>) -> Result<Response<RestartJobResponse>, Status> {
        let (record, created) = self.restart(request.into_inner()).await?;
        Ok(Response::new(RestartJobResponse { job: self.tell_one(record).await?, created }))
    }

    async fn get_result(&self, request: Request<GetResultRequest>) -> Result<Response<GetResultResponse>, Status> {
        let (record, job_toml) = self.stored(&request.into_inner().id).await?;
        let no_result = |why: String| Status::failed_precondition(format!("job {} has no result: {why}", record.id));
        match record.state {
            JobState::Succeeded => {}
            JobState::Failed => return Err(no_result(record.reason.clone())),
            JobState::Cancelled => return Err(no_result("it was cancelled".to_owned())),
            JobState::Tainted => return Err(no_result(format!("it is tainted: {}", record.reason))),
            _ => return Err(no_result("it has not ended: wait for its end".to_owned())),
        }
        let result = self.store.result(&record.id).await.map_err(store_failed)?;
        Ok(Response::new(GetResultResponse {
            job: Some(convert::job(&record)),
            job_toml,
            result_digest: record.result_digest.map(|d| d.0.to_vec()).unwrap_or_default(),
            history: result.history.iter().map(Into::into).collect(),
            artefacts: result.artefacts.into_iter().map(Into::into).collect(),
        }))
    }

    async fn list_workers(&self, _: Request<ListWorkersRequest>) -> Result<Response<ListWorkersResponse>, Status> {
        let workers = self.ask(|reply| Command::Workers { reply }).await?;
        Ok(Response::new(ListWorkersResponse { workers: workers.into_iter().map(convert::worker).collect() }))
    }

    async fn get_demand(&self, _: Request<GetDemandRequest>) -> Result<Response<GetDemandResponse>, Status> {
        let Demand { wanted, slots, busy } = self.ask(|reply| Command::Demand { reply }).await?;
        Ok(Response::new(GetDemandResponse { wanted, slots, busy }))
    }
}
