-- Forecasts: the time that the plan of a job expects it to take on one core, in microseconds. Their sums by state tell
-- how much work waits and runs; metrics ask for it at every scrape.

-- Jobs of before have no forecast: they count as a minute, as does a job whose plan tells no time (see forecasts.rs).
alter table jobs add column forecast_us integer not null default 60000000;

-- Kept for the jobs that wait and run; 0 in the other states.
alter table job_counts add column forecast_us integer not null default 0;

update job_counts set forecast_us = (
    select coalesce(sum(jobs.forecast_us), 0) from jobs where jobs.state = job_counts.state
)
where state in ('queued', 'running');

drop trigger job_counts_insert;
drop trigger job_counts_update;
drop trigger job_counts_delete;

create trigger job_counts_insert after insert on jobs
begin
    update job_counts set
        jobs = jobs + 1, forecast_us = forecast_us + iif(state in ('queued', 'running'), new.forecast_us, 0)
    where state = new.state;
end;

create trigger job_counts_update after update of state on jobs when new.state <> old.state
begin
    update job_counts set
        jobs = jobs - 1, forecast_us = forecast_us - iif(state in ('queued', 'running'), old.forecast_us, 0)
    where state = old.state;
    update job_counts set
        jobs = jobs + 1, forecast_us = forecast_us + iif(state in ('queued', 'running'), new.forecast_us, 0)
    where state = new.state;
end;

create trigger job_counts_delete after delete on jobs
begin
    update job_counts set
        jobs = jobs - 1, forecast_us = forecast_us - iif(state in ('queued', 'running'), old.forecast_us, 0)
    where state = old.state;
end;
