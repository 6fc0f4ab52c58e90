//! Resolved arguments of `evogait robot`.

use super::raw;
use crate::error::Error;
use sim_core::exchange::Format;
use sim_core::physics::Scale;
use std::path::{Path, PathBuf};

#[derive(Debug)]
pub struct Robot {
    /// Path of a robot file, or name of a robot that ships.
    pub robot: String,
    pub variant: Option<String>,
    /// Length of 1 mu in the unit of the file.
    pub unit: Option<f64>,
    pub output: Option<RobotOutput>,
    pub json: bool,
}

/// Output of `evogait robot`, and its file.
#[derive(Debug, PartialEq)]
pub enum RobotOutput {
    Picture(PathBuf, PictureFormat),
    /// Export to another format; to standard output without a file.
    Export {
        format: Format,
        scale: Scale,
        to: Option<PathBuf>,
    },
    /// Robot file in TOML; to standard output without a file.
    File(Option<PathBuf>),
}

impl RobotOutput {
    /// Returns the output. Without `--format` the ending of the file name selects it.
    pub(super) fn of(raw: &mut raw::Robot) -> Result<Option<Self>, Error> {
        let ending = raw.out.as_deref().and_then(Path::extension).and_then(|e| e.to_str());
        let format = raw.format.or(match ending {
            Some("xml" | "mjcf") => Some(raw::RobotFormat::Mjcf),
            Some("urdf") => Some(raw::RobotFormat::Urdf),
            Some("toml") => Some(raw::RobotFormat::Toml),
            _ => None,
        });
        let usage = |message: String| Err(Error::Usage { message });
        match (format, raw.out.take()) {
            (Some(_), None) if raw.json => {
                usage("--json and --format both print to standard output: write one to a file with --out FILE".into())
            }
            (None | Some(raw::RobotFormat::Toml), _) if raw.scale.is_some() => {
                usage("--scale belongs to MJCF and URDF: add --format mjcf or --format urdf".into())
            }
            (Some(raw::RobotFormat::Toml), to) => Ok(Some(Self::File(to))),
            (Some(raw::RobotFormat::Mjcf), to) => Ok(Some(Self::export(Format::Mjcf, raw.scale, to))),
            (Some(raw::RobotFormat::Urdf), to) => Ok(Some(Self::export(Format::Urdf, raw.scale, to))),
            (None, Some(path)) => PictureFormat::of(&path).map(|format| Some(Self::Picture(path, format))),
            (None, None) => Ok(None),
        }
    }
}

impl RobotOutput {
    fn export(format: Format, scale: Option<raw::RobotScale>, to: Option<PathBuf>) -> Self {
        Self::Export { format, scale: scale.map_or(Scale::Paper, Scale::from), to }
    }
}

/// Format of pictures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PictureFormat {
    Svg,
    Png,
}

impl PictureFormat {
    fn of(path: &Path) -> Result<Self, Error> {
        match path.extension().and_then(|e| e.to_str()) {
            Some("svg") => Ok(Self::Svg),
            Some("png") => Ok(Self::Png),
            _ => Err(Error::Usage {
                message: format!(
                    "--out = \"{}\" has an unknown ending: allowed are .svg or .png (a picture), .xml or .mjcf \
                     (MJCF), .urdf and .toml",
                    path.display()
                ),
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::resolve::resolve;
    use super::super::{Command, Resolved};
    use super::*;
    use clap::Parser as _;

    #[test]
    fn robot_output_follows_format_or_file_name() {
        let output = |line: &str| {
            let typed = ["evogait", "robot", "lizard"].into_iter().chain(line.split_whitespace());
            match resolve(raw::Cli::try_parse_from(typed).unwrap()) {
                Ok(Resolved { command: Command::Robot(robot), .. }) => Ok(robot.output),
                Ok(_) => unreachable!("`evogait robot` is that command"),
                Err(error) => Err(error.to_string()),
            }
        };
        let export = |format, scale, to: Option<&str>| {
            Ok(Some(RobotOutput::Export { format, scale, to: to.map(PathBuf::from) }))
        };
        assert_eq!(output(""), Ok(None));
        assert_eq!(output("--out a.png"), Ok(Some(RobotOutput::Picture("a.png".into(), PictureFormat::Png))));
        assert_eq!(output("--format mjcf"), export(Format::Mjcf, Scale::Paper, None));
        assert_eq!(output("--out a.xml --scale real"), export(Format::Mjcf, Scale::Real, Some("a.xml")));
        assert_eq!(output("--out a.urdf --json"), export(Format::Urdf, Scale::Paper, Some("a.urdf")));
        assert_eq!(output("--out a.xml --format urdf"), export(Format::Urdf, Scale::Paper, Some("a.xml")));
        assert_eq!(output("--out a.toml"), Ok(Some(RobotOutput::File(Some("a.toml".into())))));
        assert_eq!(output("--format toml"), Ok(Some(RobotOutput::File(None))));
        assert!(output("--out a.toml --scale real").unwrap_err().contains("--format"));
        assert!(output("--format urdf --json").unwrap_err().contains("--out FILE"));
        assert!(output("--scale real").unwrap_err().contains("--format"));
        assert!(output("--out a.stl").unwrap_err().contains(".urdf"));
    }
}
