//! Commands that repeat, on this machine, the task that ended a job because it failed too often.

use crate::console::quoted;
use proto::v1::Poisoned;
use sim_core::procedure::evolve::Task;
use sim_core::procedure::evolve::finish::Question;
use sim_core::search::Scored;
use std::path::Path;

/// Candidate of a task, and the question about it.
pub struct Subject {
    /// The candidate; its score is valid only with a question.
    pub candidate: Scored,
    /// Question of the finish; `None` for an evaluation of the search.
    pub question: Option<Question>,
}

impl Subject {
    /// Returns the candidate of a task; `None` for a preparation, and for tasks that this build can't read.
    pub fn of(poisoned: &Poisoned) -> Option<Self> {
        match Task::decode(&poisoned.task).ok().filter(|_| poisoned.round > 0)? {
            Task::Evaluate { generation, candidate, genotype } => {
                Some(Self { candidate: Scored { generation, candidate, score: 0.0, genotype }, question: None })
            }
            Task::Examine(asked) => Some(Self { candidate: asked.candidate, question: Some(asked.question) }),
        }
    }

    /// Formats the genotype as an argument of `--genome`, with all bits of each number.
    pub fn genotype(&self) -> String {
        self.candidate.genotype.numbers().iter().map(f64::to_string).collect::<Vec<_>>().join(",")
    }
}

/// Returns the name of a question for `evogait evaluate --question`.
pub fn question(question: Question) -> &'static str {
    match question {
        Question::Fresh => "fresh",
        Question::Reference => "reference",
        Question::LessFriction => "less-friction",
        Question::MoreFriction => "more-friction",
        Question::WithoutReuse => "without-reuse",
        Question::Traces => "traces",
    }
}

/// Returns the command for a job of a coordinator.
pub fn command_for_remote_job(id: &str, poisoned: &Poisoned) -> String {
    let id = quoted(id);
    match poisoned.round {
        0 => format!("evogait show {id} --toml > job.toml; evogait validate job.toml"),
        _ => format!("evogait evaluate {id}"),
    }
}

/// Returns the command for a job file.
pub fn command_for_job_file(file: &Path, poisoned: &Poisoned) -> String {
    let file = quoted(file.display());
    let Some(subject) = Subject::of(poisoned) else { return format!("evogait validate {file}") };
    let asked = subject.question.map_or_else(String::new, |q| format!(" --question {}", question(q)));
    let Scored { generation, candidate, .. } = subject.candidate;
    format!(
        "evogait evaluate {file} --generation {generation} --candidate {candidate}{asked} --genome={}",
        subject.genotype()
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use sim_core::procedure::evolve::finish::Examination;

    fn poisoned(round: u32, task: &Task) -> Poisoned {
        Poisoned { round, task: task.encode(), ..Poisoned::default() }
    }

    #[test]
    fn command_of_a_task_names_its_candidate_and_question() {
        let candidate = Scored { generation: 3, candidate: 4, score: 1.0, genotype: vec![0.1, -2.0].into() };
        let evaluate = Task::Evaluate { generation: 3, candidate: 4, genotype: vec![0.1, -2.0].into() };
        let examine = Task::Examine(Examination::new(Question::WithoutReuse, &candidate));
        let here = |task| command_for_job_file(Path::new("job.toml"), &poisoned(4, task));
        let (start, genotype) = ("evogait evaluate job.toml --generation 3 --candidate 4", "--genome=0.1,-2");
        assert_eq!(here(&evaluate), format!("{start} {genotype}"));
        assert_eq!(here(&examine), format!("{start} --question without-reuse {genotype}"));
    }

    #[test]
    fn command_of_a_preparation_is_validate() {
        let preparation = Poisoned::default();
        assert_eq!(command_for_job_file(Path::new("job.toml"), &preparation), "evogait validate job.toml");
        assert!(command_for_remote_job("j1-abc", &preparation).ends_with("evogait validate job.toml"));
    }
}
