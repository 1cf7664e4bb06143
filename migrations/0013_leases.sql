-- Leases of workers in other processes. Those of the server's own workers have none of these.

-- Name of the process that runs the job, or ran it last; empty for a worker of the server itself.
alter table jobs add column worker text not null default '';
-- Name of the API key by which it was leased; only requests with this key may renew or end the lease.
alter table jobs add column worker_key text not null default '';
-- ID of the request that leased the job: a repeated one gets the same job again.
alter table jobs add column claim text;

create index jobs_claims on jobs (claim) where claim is not null;
-- Those whose lease is renewed from outside, at the start of the server.
create index jobs_of_workers on jobs (worker) where worker <> '' and state = 'running';
