//! Tables for pandas, spreadsheets and hardware. Numbers are written so that they read back to the same bits.

use super::result::{ArchiveRow, AuditRow};
use crate::values::Generation;
use sim_core::report::{GaitTrace, PathMode, PathTrace, TraceSample};
use std::fmt::Write as _;

/// history.csv: a row a generation. Statistics are NaN where all evaluations failed; `best_so_far` is empty then.
pub fn history(history: &[Generation]) -> String {
    let mut out = "generation,min,lower_quartile,median,upper_quartile,max,mean,best_so_far,failed\n".to_owned();
    for g in history {
        let best = cell(g.best_so_far);
        let numbers = [g.min, g.lower_quartile, g.median, g.upper_quartile, g.max, g.mean].map(|v| v.to_string());
        // Writing to a String can't fail.
        let _ = writeln!(out, "{},{},{best},{}", g.generation, numbers.join(","), g.failed);
    }
    out
}

/// archive.csv: a row a genotype, best on the reference setting first. `reference` is empty where it could not be
/// scored.
pub fn archive(rows: &[ArchiveRow]) -> String {
    let mut out = "rank,generation,candidate,search,reference\n".to_owned();
    for ArchiveRow { rank, generation, candidate, search, reference } in rows {
        let _ = writeln!(out, "{rank},{generation},{candidate},{search},{}", cell(*reference));
    }
    out
}

/// audits.csv: a row a global best of the search, scored with reuse of transitions and without.
pub fn audits(rows: &[AuditRow]) -> String {
    let mut out = "generation,candidate,with_reuse,without_reuse,gap\n".to_owned();
    for AuditRow { generation, candidate, with_reuse, without_reuse, gap } in rows {
        let _ = writeln!(out, "{generation},{candidate},{with_reuse},{},{}", cell(*without_reuse), cell(*gap));
    }
    out
}

/// Empty where there is no number.
fn cell(value: Option<f64>) -> String {
    value.map_or_else(String::new, |v| v.to_string())
}

/// A gait's samples: time (s), joint targets and angles (rad), pivot position (mu), rotation (unit quaternion), yaw (rad).
pub fn gait(trace: &GaitTrace) -> String {
    samples(&trace.joints, &trace.samples)
}

/// The same of any motion of these joints.
pub fn samples(joints: &[String], samples: &[TraceSample]) -> String {
    let mut head = vec!["time".to_owned()];
    for what in ["target", "angle"] {
        head.extend(joints.iter().map(|joint| format!("{what}_{joint}")));
    }
    head.extend(["x", "y", "z", "qx", "qy", "qz", "qw", "yaw"].map(str::to_owned));
    let mut out = head.join(",") + "\n";
    for sample in samples {
        let joints = sample.targets.iter().chain(&sample.angles).map(f32::to_string);
        let pose = sample.position.iter().chain(&sample.rotation).chain([&sample.yaw]).map(f64::to_string);
        let row: Vec<String> = [sample.time.to_string()].into_iter().chain(joints).chain(pose).collect();
        out += &row.join(",");
        out.push('\n');
    }
    out
}

/// A path's ways: how it was run, point by point, mu.
pub fn paths(paths: &[PathTrace]) -> String {
    let mut out = "mode,point,x,y\n".to_owned();
    for path in paths {
        for (i, [x, y]) in path.way.iter().enumerate() {
            let _ = writeln!(out, "{},{i},{x},{y}", mode(path.mode));
        }
    }
    out
}

/// The word for a way to run a path.
pub fn mode(mode: PathMode) -> &'static str {
    match mode {
        PathMode::Tree => "tree",
        PathMode::Resimulated => "resimulated",
        PathMode::Continuous => "continuous",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proto::v1::{Row, Value};

    #[test]
    fn every_number_reads_back_to_its_bits() {
        let values = [0.1, -0.0, 1.0 / 3.0, f64::MIN_POSITIVE, 1e300];
        let sample = TraceSample {
            time: values[0],
            targets: vec![0.1, -0.0],
            angles: vec![1.0 / 3.0, f32::MIN_POSITIVE],
            position: [values[1], values[2], values[3]],
            rotation: [values[4], 0.0, 0.0, 1.0],
            yaw: -values[2],
        };
        let joints = vec!["a".to_owned(), "b".to_owned()];
        let csv = gait(&GaitTrace { parameters: vec![], joints, samples: vec![sample.clone()], unstable: None });
        let (head, row) = csv.trim_end().split_once('\n').unwrap();
        assert_eq!(head, "time,target_a,target_b,angle_a,angle_b,x,y,z,qx,qy,qz,qw,yaw");
        let cells: Vec<&str> = row.split(',').collect();
        assert_eq!(cells.len(), 13);
        let joints: Vec<u32> = cells[1..5].iter().map(|c| c.parse::<f32>().unwrap().to_bits()).collect();
        assert_eq!(joints, [0.1f32, -0.0, 1.0 / 3.0, f32::MIN_POSITIVE].map(f32::to_bits));
        let pose: Vec<u64> = cells[5..].iter().map(|c| c.parse::<f64>().unwrap().to_bits()).collect();
        let expected = [values[1], values[2], values[3], values[4], 0.0, 0.0, 1.0, -values[2]];
        assert_eq!(pose, expected.map(f64::to_bits));
    }

    #[test]
    fn a_generation_without_a_score_leaves_its_best_empty() {
        let failed = Value { name: "failed".to_owned(), unit: String::new(), value: Some(20.0) };
        let row = Row { series: "generations".to_owned(), index: 0, values: vec![failed] };
        let failed = Generation::of(&row).expect("a generation");
        assert!(history(&[failed]).ends_with("\n0,NaN,NaN,NaN,NaN,NaN,NaN,,20\n"));
    }
}
