-- The method of a job beside the job, so that a listing can filter by it without reading requests.

alter table jobs add column method text;

update jobs set method = coalesce(
    (select body ->> '$.method.type' from job_requests where job_requests.job = jobs.seq), 'auto'
);

create index jobs_by_method on jobs (method, seq);

create trigger job_methods after insert on job_requests
begin
    update jobs set method = coalesce(new.body ->> '$.method.type', 'auto') where seq = new.job;
end;
