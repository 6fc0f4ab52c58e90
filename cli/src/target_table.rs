//! Table of joint targets for a job that simulates: CSV with a time and a column per joint, like the file
//! `trajectories/gait-1.csv` of a run, or exported from a spreadsheet.

use crate::error::Error;
use crate::inputs;
use sim_core::base::error::Invalid;
use sim_core::base::limits::MAX_TOML_LENGTH;
use sim_core::model::Robot;
use sim_core::problem::TargetTable;
use std::fs::File;
use std::io::Read as _;
use std::path::Path;

/// Prefix of a joint's name in the head of a run's trajectories.
const TARGET: &str = "target_";
/// Columns of a run's trajectories that are not targets.
const OTHERS: [&str; 8] = ["x", "y", "z", "qx", "qy", "qz", "qw", "yaw"];

/// Reads a table of targets for the joints of this robot.
pub fn read(path: &Path, robot: &Robot) -> Result<TargetTable, Error> {
    let mut text = String::new();
    let read = File::open(path).and_then(|file| file.take(MAX_TOML_LENGTH as u64 * 8).read_to_string(&mut text));
    read.map_err(|source| Error::read(path, source))?;
    inputs::record(path);
    parse(&text, robot).map_err(|reason| Error::Invalid {
        file: path.display().to_string(),
        source: Invalid::Conflict { field: "targets".into(), reason },
    })
}

fn parse(text: &str, robot: &Robot) -> Result<TargetTable, String> {
    let mut lines = text.trim_start_matches('\u{feff}').lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
    let (_, head) = lines.next().ok_or("the file is empty")?;
    let head: Vec<&str> = head.split(',').map(|name| name.trim().trim_matches('"')).collect();
    if head[0] != "time" {
        return Err(format!("line 1: the first column is \"{}\", but must be \"time\" (s)", head[0]));
    }
    let joints = robot.joint_names();
    let place = |joint: &String| {
        let named = |name: &&str| name.strip_prefix(TARGET).unwrap_or(name) == joint;
        let mut places = head.iter().enumerate().filter(|(_, name)| named(name)).map(|(i, _)| i);
        match (places.next(), places.next()) {
            (Some(place), None) => Ok(place),
            (Some(_), Some(_)) => Err(format!("line 1: there are two columns for joint {joint}")),
            (None, _) => Err(format!(
                "line 1: there is no column for joint {joint} (\"{joint}\" or \"{TARGET}{joint}\"): robot \"{}\" has joints {}",
                robot.name,
                joints.join(", ")
            )),
        }
    };
    let places = joints.iter().map(place).collect::<Result<Vec<usize>, String>>()?;
    let known = |name: &str| {
        OTHERS.contains(&name) || name.strip_prefix("angle_").is_some_and(|j| joints.iter().any(|n| n == j))
    };
    if let Some((_, other)) = head.iter().enumerate().skip(1).find(|(i, name)| !places.contains(i) && !known(name)) {
        let joints = joints.join(", ");
        return Err(format!(
            "line 1: column \"{other}\" belongs to no joint of robot \"{}\": its joints are {joints}",
            robot.name
        ));
    }
    let row = |(i, line): (usize, &str)| {
        let cells: Vec<&str> = line.split(',').map(str::trim).collect();
        if cells.len() != head.len() {
            return Err(format!("line {}: it has {} cells, but the head has {}", i + 1, cells.len(), head.len()));
        }
        let number = |place: usize| {
            let wrong =
                || format!("line {}: \"{}\" in column {} is not a finite number", i + 1, cells[place], head[place]);
            cells[place].parse::<f64>().ok().filter(|number| number.is_finite()).ok_or_else(wrong)
        };
        std::iter::once(0).chain(places.iter().copied()).map(number).collect::<Result<Vec<f64>, String>>()
    };
    Ok(TargetTable { joints: joints.clone(), rows: lines.map(row).collect::<Result<_, String>>()? })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn robot() -> Robot {
        let toml = "name = \"pair\"\npivot = \"A\"\n[[module]]\nname = \"A\"\nkind = \"cosmo\"\n";
        Robot::compile(&toml::from_str(toml).unwrap()).unwrap()
    }

    #[test]
    fn tables_with_extra_columns_or_quotes_are_read() {
        let robot = robot();
        let joints = robot.joint_names();
        assert_eq!(joints, ["A"]);
        let expected = TargetTable { joints, rows: vec![vec![0.0, 0.1], vec![0.5, -0.25]] };
        for text in [
            "time,A\n0,0.1\n0.5,-0.25\n",
            "\u{feff}time, \"A\"\r\n0, 0.1\r\n\r\n5e-1, -0.25",
            "time,target_A,angle_A,x,y,z,qx,qy,qz,qw,yaw\n0,0.1,9,1,1,1,0,0,0,1,0\n0.5,-0.25,9,1,1,1,0,0,0,1,0\n",
        ] {
            assert_eq!(parse(text, &robot).as_ref(), Ok(&expected), "{text}");
        }
    }

    #[test]
    fn invalid_table_is_refused_with_its_line() {
        for (text, said) in [
            ("", "the file is empty"),
            ("t,A\n", "line 1: the first column is \"t\""),
            ("time\n0\n", "line 1: there is no column for joint A"),
            ("time,A,target_A\n", "line 1: there are two columns for joint A"),
            ("time,A,B\n", "line 1: column \"B\" belongs to no joint of robot \"pair\": its joints are A"),
            ("time,A\n0,1\n1\n", "line 3: it has 1 cells, but the head has 2"),
            ("time,A\n0,one\n", "line 2: \"one\" in column A is not a finite number"),
            ("time,A\n0,nan\n", "line 2: \"nan\" in column A is not a finite number"),
        ] {
            let told = parse(text, &robot()).unwrap_err();
            assert!(told.contains(said), "{told}");
        }
    }
}
