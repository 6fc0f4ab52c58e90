//! Wire types to sim-core types and back. Floating-point numbers keep their bits, NaN payloads and -0 too.

use crate::v1;
use sim_core::base::digest::Digest;
use sim_core::base::limits::{MAX_GENOME, MAX_POPULATION};
use sim_core::base::score::Counts;
use sim_core::evaluate::Evaluation;
use sim_core::procedure::evolve::finish::{Examination, Question};
use sim_core::search::Scored;

/// A message that can't mean anything. Not retryable: the sender must change.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ConvertError {
    /// A field that has to be there is not.
    #[error("{field} is missing")]
    Missing {
        /// Which.
        field: &'static str,
    },
    /// Bytes that are no SHA-256 digest.
    #[error("{field} has {found} bytes: a SHA-256 digest has 32")]
    DigestLength {
        /// Which.
        field: &'static str,
        /// How many bytes there are.
        found: usize,
    },
    /// A genome beyond the limit.
    #[error("{field} has {found} parameters: at most {MAX_GENOME} are allowed")]
    GenomeLength {
        /// Which.
        field: &'static str,
        /// How many there are.
        found: usize,
    },
    /// A question that this version does not know.
    #[error("question {found} is not known")]
    Question {
        /// Its number.
        found: i32,
    },
    /// A range of candidates that is empty or reaches beyond the largest population.
    #[error(
        "candidates {first} and the {count} from there on are no range: 1 to {MAX_POPULATION} candidates of a \
         generation of at most {MAX_POPULATION} are allowed"
    )]
    Range {
        /// Index of the first.
        first: u32,
        /// How many.
        count: usize,
    },
}

/// Reads a digest. `field` names it in the error.
pub fn digest(field: &'static str, bytes: &[u8]) -> Result<Digest, ConvertError> {
    bytes.try_into().map(Digest).map_err(|_| ConvertError::DigestLength { field, found: bytes.len() })
}

impl From<&Scored> for v1::ScoredCandidate {
    fn from(scored: &Scored) -> Self {
        Self {
            generation: scored.generation,
            candidate: scored.candidate,
            score: Some(scored.score),
            genome: scored.genome.clone(),
        }
    }
}

impl TryFrom<v1::ScoredCandidate> for Scored {
    type Error = ConvertError;

    fn try_from(wire: v1::ScoredCandidate) -> Result<Self, ConvertError> {
        if wire.genome.len() > MAX_GENOME {
            return Err(ConvertError::GenomeLength { field: "genome", found: wire.genome.len() });
        }
        Ok(Self {
            generation: wire.generation,
            candidate: wire.candidate,
            score: wire.score.ok_or(ConvertError::Missing { field: "score" })?,
            genome: wire.genome,
        })
    }
}

impl From<Counts> for v1::Counts {
    fn from(counts: Counts) -> Self {
        let Counts { rollouts, unstable, simulated_ms, edges, rejected, nodes } = counts;
        Self { rollouts, unstable, simulated_ms, edges, rejected, nodes }
    }
}

impl From<v1::Counts> for Counts {
    fn from(wire: v1::Counts) -> Self {
        let v1::Counts { rollouts, unstable, simulated_ms, edges, rejected, nodes } = wire;
        Self { rollouts, unstable, simulated_ms, edges, rejected, nodes }
    }
}

impl From<&Evaluation> for v1::EvaluationResult {
    fn from(evaluation: &Evaluation) -> Self {
        Self { score: evaluation.score, counts: Some(evaluation.counts.into()) }
    }
}

impl From<Question> for v1::Question {
    fn from(question: Question) -> Self {
        match question {
            Question::Fresh => Self::Fresh,
            Question::Reference => Self::Reference,
            Question::LessFriction => Self::LessFriction,
            Question::MoreFriction => Self::MoreFriction,
            Question::WithoutReuse => Self::WithoutReuse,
            Question::Traces => Self::Traces,
        }
    }
}

/// The examination that a task asks for.
pub fn examination(task: v1::ExamineTask) -> Result<Examination, ConvertError> {
    let question = match v1::Question::try_from(task.question) {
        Ok(v1::Question::Fresh) => Question::Fresh,
        Ok(v1::Question::Reference) => Question::Reference,
        Ok(v1::Question::LessFriction) => Question::LessFriction,
        Ok(v1::Question::MoreFriction) => Question::MoreFriction,
        Ok(v1::Question::WithoutReuse) => Question::WithoutReuse,
        Ok(v1::Question::Traces) => Question::Traces,
        Ok(v1::Question::Unspecified) | Err(_) => return Err(ConvertError::Question { found: task.question }),
    };
    let candidate = task.candidate.ok_or(ConvertError::Missing { field: "candidate" })?.try_into()?;
    Ok(Examination { question, candidate })
}

/// Scores as the wire and the store have them.
pub fn scores(scores: &[Option<f64>]) -> Vec<v1::Score> {
    scores.iter().map(|&score| v1::Score { score }).collect()
}

/// The evaluations of a result, each with its index in the generation.
pub fn evaluations(result: &v1::EvaluateResult) -> Result<Vec<Evaluation>, ConvertError> {
    range_length(result.first, result.evaluations.len())?;
    Ok((result.first..)
        .zip(&result.evaluations)
        .map(|(candidate, e)| Evaluation {
            candidate,
            score: e.score,
            counts: e.counts.map(Counts::from).unwrap_or_default(),
        })
        .collect())
}

/// How many candidates a range has, if it can be one.
pub fn range_length(first: u32, count: usize) -> Result<u32, ConvertError> {
    let wrong = ConvertError::Range { first, count };
    let n = u32::try_from(count).map_err(|_| wrong.clone())?;
    match first.checked_add(n) {
        Some(end) if n > 0 && end <= MAX_POPULATION => Ok(n),
        _ => Err(wrong),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Through bytes and back.
    fn over_the_wire<M: prost::Message + Default>(message: &M) -> M {
        M::decode(message.encode_to_vec().as_slice()).expect("what was encoded decodes")
    }

    const ODD: [u64; 5] = [0x8000_0000_0000_0000, 0, 0x7ff8_0000_dead_beef, 0xfff0_0000_0000_0000, 1];

    #[test]
    fn scored_candidates_keep_their_bits() {
        for bits in ODD {
            let scored = Scored {
                generation: 3,
                candidate: 7,
                score: f64::from_bits(bits),
                genome: ODD.map(f64::from_bits).to_vec(),
            };
            let back = Scored::try_from(over_the_wire(&v1::ScoredCandidate::from(&scored))).unwrap();
            assert_eq!(back.score.to_bits(), bits);
            assert_eq!(back.genome.iter().map(|v| v.to_bits()).collect::<Vec<_>>(), ODD);
            assert_eq!((back.generation, back.candidate), (3, 7));
        }
    }

    #[test]
    fn evaluations_keep_their_bits_and_failures_stay_failures() {
        let counts = Counts { rollouts: 1, unstable: 2, simulated_ms: 3, edges: 4, rejected: 5, nodes: 6 };
        let scores: Vec<Option<f64>> = ODD.iter().map(|b| Some(f64::from_bits(*b))).chain([None]).collect();
        let result = v1::EvaluateResult {
            generation: 1,
            first: 10,
            evaluations: scores.iter().map(|&score| (&Evaluation { candidate: 0, score, counts }).into()).collect(),
        };
        let back = evaluations(&over_the_wire(&result)).unwrap();
        let bits = |s: Option<f64>| s.map(f64::to_bits);
        for (i, (e, s)) in back.iter().zip(&scores).enumerate() {
            assert_eq!((e.candidate, bits(e.score), e.counts), (10 + i as u32, bits(*s), counts));
        }
        assert_eq!(back.len(), scores.len());
    }

    #[test]
    fn examinations_keep_their_question_and_their_bits() {
        let candidate = Scored { generation: 2, candidate: 4, score: f64::from_bits(ODD[2]), genome: vec![-0.0] };
        for question in [
            Question::Fresh,
            Question::Reference,
            Question::LessFriction,
            Question::MoreFriction,
            Question::WithoutReuse,
            Question::Traces,
        ] {
            let wire = v1::Question::from(question).into();
            let task = v1::ExamineTask { round: 9, index: 1, question: wire, candidate: Some((&candidate).into()) };
            let back = examination(over_the_wire(&task)).unwrap();
            assert!(back.is(question, &candidate));
            assert_eq!(back.candidate.score.to_bits(), ODD[2]);
            assert!(back.candidate.genome[0].is_sign_negative());
        }
        let later = v1::ExamineTask { question: 77, ..Default::default() };
        assert_eq!(examination(later), Err(ConvertError::Question { found: 77 }));
        let odd = ODD.map(f64::from_bits).map(Some);
        let result = v1::ExamineResult { scores: scores(&[odd.as_slice(), &[None]].concat()), ..Default::default() };
        let back: Vec<_> = over_the_wire(&result).scores.iter().map(|s| s.score.map(f64::to_bits)).collect();
        assert_eq!(back, [ODD.map(Some).as_slice(), &[None]].concat());
    }

    #[test]
    fn what_means_nothing_is_refused_with_a_reason() {
        assert_eq!(
            digest("job_digest", &[1, 2]).unwrap_err().to_string(),
            "job_digest has 2 bytes: a SHA-256 digest has 32"
        );
        let no_score = v1::ScoredCandidate { score: None, ..Default::default() };
        assert_eq!(Scored::try_from(no_score), Err(ConvertError::Missing { field: "score" }));
        let long = v1::ScoredCandidate { genome: vec![0.0; MAX_GENOME + 1], score: Some(0.0), ..Default::default() };
        assert!(matches!(Scored::try_from(long), Err(ConvertError::GenomeLength { found, .. }) if found > MAX_GENOME));
        for (first, count) in [(0, 0), (u32::MAX, 2), (MAX_POPULATION, 1), (0, usize::MAX)] {
            assert_eq!(range_length(first, count), Err(ConvertError::Range { first, count }));
        }
        assert_eq!(range_length(MAX_POPULATION - 1, 1), Ok(1));
    }
}
