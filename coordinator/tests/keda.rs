//! Tests of the external scaler with a client that is generated from KEDA's protocol.

use coordinator::{Config, StoreUrl};
use proto::externalscaler::external_scaler_client::ExternalScalerClient;
use proto::externalscaler::{GetMetricsRequest, ScaledObjectRef};
use proto::v1::job_service_client::JobServiceClient;
use proto::v1::{CancelJobRequest, SubmitJobRequest};
use std::time::Duration;
use tonic::Code;

/// Example job.
const JOB: &str = include_str!("../../scenarios/jobs/quadropod-quick.toml");

fn trigger(slots_per_worker: &str) -> ScaledObjectRef {
    let metadata = [("slotsPerWorker".to_owned(), slots_per_worker.to_owned())];
    ScaledObjectRef { name: "worker".to_owned(), namespace: "evogait".to_owned(), scaler_metadata: metadata.into() }
}

#[tokio::test]
async fn scaler_reports_slots_that_jobs_could_use() {
    let keda = Some(telemetry::Bind { addr: ([127, 0, 0, 1], 0).into(), beyond_loopback: false });
    let running = coordinator::serve(Config { keda, ..Config::embedded(StoreUrl::Memory) }).await.unwrap();
    let url = format!("http://{}", running.keda_addr().unwrap());
    let mut scaler = ExternalScalerClient::connect(url).await.unwrap();
    let mut jobs = JobServiceClient::connect(running.url()).await.unwrap();

    let spec = scaler.get_metric_spec(trigger("4")).await.unwrap().into_inner().metric_specs;
    assert_eq!(spec.len(), 1);
    assert_eq!((spec[0].target_size, spec[0].target_size_float), (4, 4.0));
    for wrong in ["0", "-1", "four", ""] {
        assert_eq!(scaler.get_metric_spec(trigger(wrong)).await.unwrap_err().code(), Code::InvalidArgument, "{wrong}");
    }
    let mut active = scaler.stream_is_active(trigger("4")).await.unwrap().into_inner();
    let mut next = async || {
        let change = tokio::time::timeout(Duration::from_secs(20), active.message()).await;
        change.expect("a change is reported within seconds").unwrap().expect("the stream stays open").result
    };
    assert!(!next().await, "the scaler must be inactive without jobs");
    assert!(!scaler.is_active(trigger("4")).await.unwrap().into_inner().result);

    let submit = SubmitJobRequest { request_id: "r".to_owned(), job_toml: JOB.to_owned(), ..Default::default() };
    let job = jobs.submit_job(submit).await.unwrap().into_inner().job.unwrap();
    assert!(next().await);
    assert!(scaler.is_active(trigger("4")).await.unwrap().into_inner().result);
    let request = GetMetricsRequest { scaled_object_ref: Some(trigger("4")), metric_name: spec[0].metric_name.clone() };
    let values = scaler.get_metrics(request.clone()).await.unwrap().into_inner().metric_values;
    let wanted = jobs.get_demand(proto::v1::GetDemandRequest {}).await.unwrap().into_inner().wanted;
    assert!(wanted > 0);
    assert_eq!((values[0].metric_value, values[0].metric_value_float), (i64::from(wanted), f64::from(wanted)));
    assert_eq!(values[0].metric_name, spec[0].metric_name);

    jobs.cancel_job(CancelJobRequest { id: job.id }).await.unwrap();
    assert!(!next().await);
    assert_eq!(scaler.get_metrics(request).await.unwrap().into_inner().metric_values[0].metric_value, 0);
    running.shutdown().await.unwrap();
}

#[tokio::test]
async fn scaler_beyond_loopback_requires_permission() {
    let keda = Some(telemetry::Bind { addr: ([0, 0, 0, 0], 0).into(), beyond_loopback: false });
    let refused = coordinator::serve(Config { keda, ..Config::embedded(StoreUrl::Memory) }).await.unwrap_err();
    assert!(refused.to_string().contains("--keda-insecure-bind"), "{refused}");
}
