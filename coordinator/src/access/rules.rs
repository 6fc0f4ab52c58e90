//! The table of who may call what.

use std::fmt;
use std::str::FromStr;

/// What the holder of a token is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// Hands jobs in, follows them and takes their results.
    Client,
    /// Computes.
    Worker,
    /// May do everything.
    Admin,
}

impl fmt::Display for Role {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Client => "client",
            Self::Worker => "worker",
            Self::Admin => "admin",
        })
    }
}

impl FromStr for Role {
    type Err = ();

    fn from_str(text: &str) -> Result<Self, ()> {
        match text {
            "client" => Ok(Self::Client),
            "worker" => Ok(Self::Worker),
            "admin" => Ok(Self::Admin),
            _ => Err(()),
        }
    }
}

/// Who may call a method.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Rule {
    /// Without a token, too.
    Anybody,
    /// With any token.
    Known,
    /// With a token of this role, or an admin's.
    Only(Role),
}

const CLIENT: Rule = Rule::Only(Role::Client);
const WORKER: Rule = Rule::Only(Role::Worker);

/// Every method of every service.
const RULES: &[(&str, &[(&str, Rule)])] = &[
    (
        "evogait.v1.JobService",
        &[
            ("SubmitJob", CLIENT),
            ("GetJob", CLIENT),
            ("ListJobs", CLIENT),
            ("WatchJob", CLIENT),
            ("CancelJob", CLIENT),
            ("PauseJob", CLIENT),
            ("ResumeJob", CLIENT),
            // Overrules what the disputes about a job's results came to.
            ("RestartJob", Rule::Only(Role::Admin)),
            ("GetResult", CLIENT),
            ("ListWorkers", CLIENT),
            ("GetDemand", CLIENT),
        ],
    ),
    ("evogait.v1.WorkerService", &[("Session", WORKER), ("Complete", WORKER)]),
    // For load balancers and supervisors, which have no tokens.
    ("grpc.health.v1.Health", &[("Check", Rule::Anybody), ("Watch", Rule::Anybody)]),
    ("grpc.reflection.v1.ServerReflection", &[("ServerReflectionInfo", Rule::Known)]),
];

/// The rule of a path such as `/evogait.v1.JobService/GetJob`.
pub(super) fn of(path: &str) -> Option<Rule> {
    let (service, method) = path.strip_prefix('/')?.split_once('/')?;
    let (_, methods) = RULES.iter().find(|(name, _)| *name == service)?;
    methods.iter().find(|(name, _)| *name == method).map(|(_, rule)| *rule)
}

#[cfg(test)]
pub(super) fn all() -> impl Iterator<Item = (String, Rule)> {
    RULES.iter().flat_map(|(service, methods)| {
        methods.iter().map(move |(method, rule)| (format!("/{service}/{method}"), *rule))
    })
}

/// The paths of all methods of all services that a coordinator has, from their descriptors.
#[cfg(test)]
pub(super) fn methods() -> Vec<String> {
    use prost::Message as _;
    let sets = crate::server::DESCRIPTORS.iter().copied().chain([tonic_reflection::pb::v1::FILE_DESCRIPTOR_SET]);
    let mut paths = Vec::new();
    for bytes in sets {
        let set = prost_types::FileDescriptorSet::decode(bytes).expect("descriptors are sound");
        for file in set.file {
            for service in &file.service {
                for method in &service.method {
                    paths.push(format!("/{}.{}/{}", file.package(), service.name(), method.name()));
                }
            }
        }
    }
    paths
}
