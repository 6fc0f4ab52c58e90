//! Standard gRPC health check: it reports if calls are accepted.

use crate::api::Api;
use proto::v1::job_service_server::JobServiceServer;
use proto::v1::worker_service_server::WorkerServiceServer;
use tonic::server::NamedService as _;
use tonic_health::ServingStatus;
use tonic_health::pb::health_server::HealthServer;
use tonic_health::server::{HealthReporter, HealthService};

/// Names of the services; the empty name stands for all of them.
const SERVICES: [&str; 3] = ["", JobServiceServer::<Api>::NAME, WorkerServiceServer::<Api>::NAME];

/// Health status of all services.
#[derive(Clone)]
pub(super) struct Health(HealthReporter);

impl Health {
    /// Creates the status of services that accept no calls yet. All services are registered before the first query.
    pub async fn new() -> Self {
        let health = Self(HealthReporter::new());
        health.set(ServingStatus::NotServing).await;
        health
    }

    /// Reports that calls are accepted.
    pub async fn serving(&self) {
        self.set(ServingStatus::Serving).await;
    }

    /// Reports that calls are no longer accepted.
    pub async fn stopping(&self) {
        self.set(ServingStatus::NotServing).await;
    }

    /// Returns the gRPC service.
    pub fn service(&self) -> HealthServer<HealthService> {
        HealthServer::new(HealthService::from_health_reporter(self.0.clone()))
    }

    async fn set(&self, status: ServingStatus) {
        for service in SERVICES {
            self.0.set_service_status(service, status).await;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tonic::Request;
    use tonic_health::pb::HealthCheckRequest;
    use tonic_health::pb::health_check_response::ServingStatus as Told;
    use tonic_health::pb::health_server::Health as _;

    #[tokio::test]
    async fn health_check_follows_start_and_stop() {
        let health = Health::new().await;
        let service = HealthService::from_health_reporter(health.0.clone());
        let told = async || {
            let mut told = Vec::new();
            for service_name in SERVICES {
                let request = HealthCheckRequest { service: service_name.to_owned() };
                told.push(service.check(Request::new(request)).await.expect("it is known").into_inner().status());
            }
            told
        };
        assert_eq!(told().await, [Told::NotServing; 3]);
        health.serving().await;
        assert_eq!(told().await, [Told::Serving; 3]);
        health.stopping().await;
        assert_eq!(told().await, [Told::NotServing; 3]);
    }
}
