//! Table of the roles that each method requires.

use std::fmt;
use std::str::FromStr;

/// Role of a token.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// Submits jobs, watches them and fetches their results.
    Client,
    /// Runs tasks.
    Worker,
    /// Permitted to call every method.
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

/// Token that a method requires.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Rule {
    /// No token.
    Anybody,
    /// Any valid token.
    Known,
    /// A token with this role or with role admin.
    Only(Role),
}

const CLIENT: Rule = Rule::Only(Role::Client);
const WORKER: Rule = Rule::Only(Role::Worker);

/// Rules of all methods, by service.
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
            // It overrides the outcome of disputes about a job's results.
            ("RestartJob", Rule::Only(Role::Admin)),
            ("GetResult", CLIENT),
            ("ListWorkers", CLIENT),
            ("GetDemand", CLIENT),
        ],
    ),
    ("evogait.v1.WorkerService", &[("Session", WORKER), ("Complete", WORKER)]),
    // Load balancers and supervisors have no tokens.
    ("grpc.health.v1.Health", &[("Check", Rule::Anybody), ("Watch", Rule::Anybody)]),
    ("grpc.reflection.v1.ServerReflection", &[("ServerReflectionInfo", Rule::Known)]),
];

/// Returns the rule of a path such as `/evogait.v1.JobService/GetJob`.
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

/// Returns the paths of all methods of all services of a coordinator, from their descriptors.
#[cfg(test)]
pub(super) fn methods() -> Vec<String> {
    use prost::Message as _;
    let sets = crate::server::DESCRIPTORS.iter().copied().chain([tonic_reflection::pb::v1::FILE_DESCRIPTOR_SET]);
    let mut paths = Vec::new();
    for bytes in sets {
        let set = prost_types::FileDescriptorSet::decode(bytes).expect("the descriptors can be decoded");
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
