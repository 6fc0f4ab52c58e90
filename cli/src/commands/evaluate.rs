//! `evogait evaluate`: one evaluation on this machine, with the same bits as on a worker.

use crate::arguments::{Evaluate, EvaluateWhat};
use crate::client::Client;
use crate::console::{self, count};
use crate::error::Error;
use crate::failed_task::Subject;
use crate::failed_task::question;
use crate::load;
use crate::progress::Label;
use crate::view::{bits, hex};
use proto::v1;
use serde::Serialize;
use sim_core::base::score::Counts;
use sim_core::evaluate::evaluate;
use sim_core::genotype::{Genotype, Misfit, NamedGene};
use sim_core::problem::Job;
use sim_core::procedure::evolve::finish::{Examination, examine};
use sim_core::search::Scored;
use std::time::Instant;

#[derive(Serialize)]
struct View {
    job_digest: String,
    engine_digest: String,
    generation: u32,
    candidate: u32,
    question: Option<&'static str>,
    /// Scores: one for an evaluation of the search, one per tree for an examination.
    scores: Vec<Option<f64>>,
    /// Bits of the scores in hexadecimal digits; "failed" if there is no score.
    bits: Vec<String>,
    rollouts: u64,
    nodes: u64,
    simulated_seconds: f64,
    seconds: f64,
}

/// Evaluates the candidate and prints the result.
pub fn run(args: Evaluate, quiet: bool) -> Result<(), Error> {
    let (job, poisoned) = match &args.what {
        EvaluateWhat::File(file) => (load::evolving(file)?, None),
        EvaluateWhat::Stored { id, on } => super::with_runtime(async {
            let mut client = Client::connect(on).await?;
            let (status, job_toml) = client.get(id).await?;
            let label = format!("job {id}");
            let job = Job::from_toml(&job_toml).map_err(|source| Error::Invalid { file: label.clone(), source })?;
            load::must_evolve(&job, &label)?;
            if !quiet && job.engine_digest().0.as_slice() != status.engine_digest {
                console::note(
                    "the engine of this build differs from that of the job: the bits may differ from a worker's",
                );
            }
            Ok((job, status.poisoned))
        })?,
    };
    let subject = subject(&args, poisoned)?;
    let Scored { generation, candidate, ref genotype, .. } = subject.candidate;
    check(&job, genotype)?;
    let start = Instant::now();
    let (scores, counts) = carry_out(&job, &subject)?;
    let view = View {
        job_digest: hex(&job.digest().0),
        engine_digest: hex(&job.engine_digest().0),
        generation,
        candidate,
        question: subject.question.map(question),
        bits: scores.iter().map(|s| bits(*s)).collect(),
        scores,
        rollouts: counts.rollouts,
        nodes: counts.nodes,
        simulated_seconds: counts.simulated_ms as f64 / 1000.0,
        seconds: start.elapsed().as_secs_f64(),
    };
    if args.json { console::say_json(&view) } else { console::say(&text(&view, &Label::of_job(&job))) }
}

fn subject(args: &Evaluate, poisoned: Option<v1::Poisoned>) -> Result<Subject, Error> {
    let usage = |message: &str| Err(Error::Usage { message: message.to_owned() });
    if let Some(genotype) = args.genotype.clone() {
        let (generation, candidate) = (args.generation, args.candidate);
        let candidate = Scored { generation, candidate, score: 0.0, genotype };
        return Ok(Subject { candidate, question: args.question });
    }
    match (poisoned.map(|poisoned| Subject::of(&poisoned)), &args.what) {
        (Some(Some(subject)), _) => Ok(subject),
        (Some(None), _) => usage(
            "the task that failed too often is not an evaluation: `evogait show` prints the command that repeats it",
        ),
        (None, EvaluateWhat::Stored { .. }) => {
            usage("this job has no candidate that failed too often: give one with --genome or --genome-file")
        }
        (None, _) => usage("the candidate is missing: give it with --genome or --genome-file"),
    }
}

/// Fails if the search of this job can't produce the genotype.
fn check(job: &Job, genotype: &Genotype) -> Result<(), Error> {
    let Err(misfit) = job.space().check(genotype) else { return Ok(()) };
    let (index, what) = match misfit {
        Misfit::Length { found, wanted } => {
            let message =
                format!("the genome has {found} numbers, but a candidate of this job has {wanted} parameters");
            return Err(Error::Usage { message });
        }
        Misfit::NotFinite { index, .. } => (index, "is not a finite number"),
        Misfit::OutOfBounds { index, .. } => (index, "is out of range"),
        Misfit::NotWhole { index, .. } => (index, "is not a whole number"),
    };
    let (genes, value) = (&job.space().genes, genotype.numbers()[index]);
    let NamedGene { name, gene, .. } = &genes[index % genes.len()];
    let (low, high) = gene.bounds();
    Err(Error::Usage {
        message: format!("number {} of the genome, {name} = {value}, {what}: allowed is {low} to {high}", index + 1),
    })
}

/// Evaluates or examines the candidate as a worker does.
fn carry_out(job: &Job, Subject { candidate, question }: &Subject) -> Result<(Vec<Option<f64>>, Counts), Error> {
    let never = || false;
    let stopped = |_| Error::Interrupted { hint: String::new() };
    match question {
        None => {
            let one = (candidate.candidate, candidate.genotype.clone());
            let done = evaluate(job, candidate.generation, &[one], &never).map_err(stopped)?;
            Ok((done.iter().map(|e| e.score).collect(), done.first().map(|e| e.counts).unwrap_or_default()))
        }
        Some(question) => {
            let answer = examine(job, &Examination::new(*question, candidate), &never).map_err(stopped)?;
            Ok((answer.scores, answer.counts))
        }
    }
}

fn text(view: &View, label: &Label) -> String {
    let mut lines = vec![format!(
        "candidate {} of generation {}{}",
        view.candidate,
        view.generation,
        view.question.map_or_else(String::new, |q| format!(", examination {q}"))
    )];
    for (score, bits) in view.scores.iter().zip(&view.bits) {
        lines.push(match score {
            Some(score) => {
                format!("  {:<13}  {} (bits {bits})", label.name, console::score_with(Some(*score), &label.unit))
            }
            None => "  failed         more rollouts are needed than planner.max_rollouts allows, or the job has no reference setting"
                .to_owned(),
        });
    }
    lines.push(format!(
        "  it took        {}: {} rollouts, {} nodes, {} of simulated time",
        console::seconds(view.seconds),
        count(view.rollouts),
        count(view.nodes),
        console::seconds(view.simulated_seconds)
    ));
    lines.push(format!("  engine digest  {}", view.engine_digest));
    lines.join("\n")
}
