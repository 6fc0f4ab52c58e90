//! A late result of a generation long sealed: it is compared with what the store has, and where it differs the candidates'
//! genomes are found again, so that somebody can decide.

use super::{Api, store_failed};
use crate::actor::Command;
use crate::record::JobId;
use crate::scheduler::{Committed, Completed, Contradicted, Delivery, Outcome, Verdict};
use crate::store::StoreError;
use sim_core::genotype::Genome;
use sim_core::problem::Job;
use sim_core::search::Optimiser;
use tonic::Status;

/// Generations whose scores are read before the search takes them in.
const AT_ONCE: u32 = 64;

impl Api {
    /// What becomes of a result that the scheduler can't compare.
    pub(super) async fn compare(&self, completed: Completed) -> Result<Verdict, Status> {
        let Delivery::Evaluations { generation, first, outcomes } = &completed.delivery else {
            return Ok(Verdict::Unknown);
        };
        let sealed = self.sealed(&completed.job, *generation).await?;
        let contradicted = differing(&sealed, *first, outcomes);
        if contradicted.is_empty() {
            return self.ask(|reply| Command::Compare { completed, contradicted: Contradicted::new(), reply }).await;
        }
        // The worker asks again if it is refused, and also if this takes too long: so it goes on without anybody waiting.
        let place = self.gates.rebuilds.pass()?;
        let (api, job, generation) = (self.clone(), completed.job.clone(), *generation);
        let compared = tokio::spawn(async move {
            let _place = place;
            let genomes = api.genomes(&job, generation).await?;
            let committed = |(index, score)| (index, Committed { score, genome: genomes[index as usize].clone() });
            let contradicted = contradicted.into_iter().map(committed).collect();
            api.ask(|reply| Command::Compare { completed, contradicted, reply }).await
        });
        compared.await.map_err(|_| Status::internal("looking for a genome failed: this is a bug, please report it"))?
    }

    /// The scores of a sealed generation.
    pub(super) async fn sealed(&self, job: &JobId, number: u32) -> Result<Vec<Option<f64>>, Status> {
        let scores = self.store.scores(job, number).await.map_err(store_failed)?;
        let missing = || StoreError::Corrupt { what: format!("generation {number} of job {job} is missing") };
        scores.ok_or_else(missing).map_err(store_failed)
    }

    /// The genomes of a generation: they follow from the scores of those before.
    async fn genomes(&self, job: &JobId, generation: u32) -> Result<Vec<Genome>, Status> {
        let (record, text) = self.stored(job.as_str()).await?;
        let unreadable = |_| Status::internal("reading the job failed: this is a bug, please report it with the job");
        let search = tokio::task::spawn_blocking(move || Job::from_toml(&text).map(|job| job.optimiser()));
        let mut search = search.await.map_err(unreadable)?.map_err(|e| Status::internal(e.to_string()))?;
        for from in (0..generation).step_by(AT_ONCE as usize) {
            let mut scores = Vec::new();
            for number in from..generation.min(from + AT_ONCE) {
                scores.push(self.sealed(&record.id, number).await?);
            }
            let told = tokio::task::spawn_blocking(move || told(search, &scores));
            search = told.await.map_err(unreadable)?;
        }
        Ok(search.ask())
    }
}

fn told(mut search: Box<dyn Optimiser>, scores: &[Vec<Option<f64>>]) -> Box<dyn Optimiser> {
    for scores in scores {
        search.tell(scores);
    }
    search
}

/// Candidates of which something else was sealed, and their scores then.
fn differing(sealed: &[Option<f64>], first: u32, outcomes: &[Outcome]) -> Vec<(u32, Option<f64>)> {
    let bits = |score: Option<f64>| score.map(f64::to_bits);
    let both = (first..).zip(outcomes).filter_map(|(i, o)| Some((i, *sealed.get(i as usize)?, o.score())));
    both.filter(|(_, sealed, late)| bits(*sealed) != bits(*late)).map(|(index, sealed, _)| (index, sealed)).collect()
}
