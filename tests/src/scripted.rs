//! A worker whose every word is chosen by the test: it speaks the protocol, and lies or fails when it is told to.

use crate::sandbox::{PATIENCE, Sandbox};
use proto::credentials::Credentials;
use proto::dial::{Dial, Way};
use proto::v1::complete_request::Result as Outcome;
use proto::v1::complete_response::Verdict;
use proto::v1::worker_service_client::WorkerServiceClient;
use proto::v1::{
    Assign, CompleteRequest, CoordinatorMessage, EvaluateResult, EvaluateTask, ExamineResult, Heartbeat, Hello,
    WorkerMessage, assign, coordinator_message, worker_message,
};
use sim_core::base::digest::Digest;
use sim_core::evaluate::evaluate;
use sim_core::problem::Job;
use sim_core::procedure::evolve::finish::{Answer, examine};
use std::sync::{Arc, Mutex};
use std::time::Duration;
use tokio::sync::mpsc::{UnboundedSender, unbounded_channel};
use tokio::task::JoinHandle;
use tokio_stream::wrappers::UnboundedReceiverStream;
use tonic::{Status, Streaming};

/// See the module. Its connection breaks when it is dropped.
pub struct Scripted {
    id: String,
    client: WorkerServiceClient<Way>,
    heard: Streaming<CoordinatorMessage>,
    /// What it was ever given: it says that it still works on it.
    given: Arc<Mutex<Vec<u64>>>,
    /// The engine that it says it computes on, if it plays a worker of another build.
    other_build: Option<Digest>,
    /// Gives signs of life.
    heart: JoinHandle<()>,
}

impl Drop for Scripted {
    fn drop(&mut self) {
        self.heart.abort();
    }
}

/// How often it gives a sign of life.
const HEARTBEAT: Duration = Duration::from_millis(300);

impl Scripted {
    /// Connects with one slot.
    pub async fn join(sandbox: &Sandbox, id: &str) -> Self {
        Self::join_by(open(sandbox), id).await
    }

    /// The same at a door that may be closed.
    pub async fn join_by(way: Way, id: &str) -> Self {
        Self::connect(way, id, None).await.expect("it is let in")
    }

    /// Connects as a worker of another build, which has this engine and no other.
    pub async fn of_another_build(sandbox: &Sandbox, id: &str, engine: Digest) -> Result<Self, Status> {
        Self::connect(open(sandbox), id, Some(engine)).await
    }

    async fn connect(way: Way, id: &str, other_build: Option<Digest>) -> Result<Self, Status> {
        let mut client = WorkerServiceClient::new(way);
        let engines: Vec<Digest> = match other_build {
            Some(engine) => vec![engine],
            None => sim_core::engines::engine_digests().into_iter().map(|(_, digest)| digest).collect(),
        };
        let hello = Hello {
            protocol: proto::PROTOCOL,
            worker_id: id.to_owned(),
            name: id.to_owned(),
            slots: 1,
            engine_digests: engines.iter().map(|digest| digest.0.to_vec()).collect(),
            version: "scripted".to_owned(),
            ..Hello::default()
        };
        let (said, outgoing) = unbounded_channel();
        said.send(WorkerMessage { message: Some(worker_message::Message::Hello(hello)) }).expect("nobody closed it");
        let stream = UnboundedReceiverStream::new(outgoing);
        let heard = client.session(stream).await?.into_inner();
        let given = Arc::new(Mutex::new(Vec::new()));
        let heart = tokio::spawn(beat(said, given.clone()));
        Ok(Self { id: id.to_owned(), client, heard, given, other_build, heart })
    }

    /// The next thing it is told.
    pub async fn hears(&mut self) -> coordinator_message::Message {
        let next = tokio::time::timeout(PATIENCE, self.heard.message()).await.expect("it is told something");
        next.expect("the session stands").and_then(|m| m.message).expect("a message")
    }

    /// Listens until it is told no more, and why.
    pub async fn is_refused(&mut self) -> Status {
        loop {
            match tokio::time::timeout(PATIENCE, self.heard.message()).await.expect("the session ends") {
                Ok(message) => drop(message.expect("a reason")),
                Err(status) => return status,
            }
        }
    }

    /// The next evaluations it is given.
    pub async fn is_given(&mut self) -> (Assign, EvaluateTask) {
        loop {
            if let coordinator_message::Message::Assign(assign) = self.hears().await
                && let Some(assign::Task::Evaluate(task)) = assign.task.clone()
            {
                self.given.lock().expect("nobody panics with it").push(assign.assignment_id);
                return (assign, task);
            }
        }
    }

    /// Does honestly all that it is given of a job, for as long as it is let.
    pub async fn works(mut self, job: Job) {
        loop {
            let coordinator_message::Message::Assign(assign) = self.hears().await else { continue };
            self.given.lock().expect("nobody panics with it").push(assign.assignment_id);
            let outcome = match assign.task.clone().expect("an assignment has a task") {
                assign::Task::Evaluate(task) => honest(&job, &task),
                assign::Task::Examine(task) => {
                    let (round, index) = (task.round, task.index);
                    let examination = proto::examination(task).expect("a question");
                    let Answer { scores, counts, traces } =
                        examine(&job, &examination, &|| false).expect("nobody stops it");
                    let traces_json = traces.map(|t| serde_json::to_vec(&t).expect("traces are JSON"));
                    Outcome::Examine(ExamineResult {
                        round,
                        index,
                        scores: proto::scores(&scores),
                        counts: Some(counts.into()),
                        traces_json: traces_json.unwrap_or_default(),
                    })
                }
            };
            self.delivers(&assign, &job, outcome).await;
        }
    }

    /// Delivers in its own name.
    pub async fn delivers(&mut self, assign: &Assign, job: &Job, outcome: Outcome) -> Verdict {
        let id = self.id.clone();
        self.delivers_as(&id, assign, job, outcome).await
    }

    /// Delivers in the name of any worker.
    pub async fn delivers_as(&mut self, worker: &str, assign: &Assign, job: &Job, outcome: Outcome) -> Verdict {
        let request = CompleteRequest {
            worker_id: worker.to_owned(),
            assignment_id: assign.assignment_id,
            job_id: assign.job_id.clone(),
            engine_digest: self.other_build.unwrap_or_else(|| job.engine_digest()).0.to_vec(),
            result: Some(outcome),
            compute_us: 1000,
        };
        self.client.complete(request).await.expect("it is answered").into_inner().verdict()
    }
}

fn open(sandbox: &Sandbox) -> Way {
    Dial::new(sandbox.url().parse().expect("an address"), &Credentials::default()).expect("no secrets").way()
}

async fn beat(said: UnboundedSender<WorkerMessage>, given: Arc<Mutex<Vec<u64>>>) {
    loop {
        let running = given.lock().expect("nobody panics with it").clone();
        let heartbeat = worker_message::Message::Heartbeat(Heartbeat { running, ..Heartbeat::default() });
        if said.send(WorkerMessage { message: Some(heartbeat) }).is_err() {
            return;
        }
        tokio::time::sleep(HEARTBEAT).await;
    }
}

/// What an honest worker delivers for a task.
pub fn honest(job: &Job, task: &EvaluateTask) -> Outcome {
    let candidates: Vec<_> = (task.first..).zip(task.genomes.iter().map(|g| g.values.clone())).collect();
    let done = evaluate(job, task.generation, &candidates, &|| false).expect("nobody stops it");
    let evaluations = done.iter().map(Into::into).collect();
    Outcome::Evaluate(EvaluateResult { generation: task.generation, first: task.first, evaluations })
}

/// The same with the last bit of the first score flipped.
pub fn one_bit_off(outcome: Outcome) -> Outcome {
    let Outcome::Evaluate(mut result) = outcome else { panic!("evaluations") };
    let first = result.evaluations.first_mut().expect("a range is not empty");
    first.score = Some(first.score.map_or(1.0, |score| f64::from_bits(score.to_bits() ^ 1)));
    Outcome::Evaluate(result)
}
