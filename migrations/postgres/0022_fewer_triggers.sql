-- The method of a job is written with its row, and not by a change of the row at every submission.
drop trigger job_methods on job_requests;
drop function job_methods();

-- Of a job without labels none is looked for at every change of its state, and of one without a study no study.
drop trigger job_labels_follow_state on jobs;
create trigger job_labels_follow_state after update of state on jobs for each row
when (new.state <> old.state and new.labels <> '{}')
execute function job_labels_follow_state();

create or replace function study_counts_update() returns trigger language plpgsql as $$
begin
    if not exists (select 1 from new_jobs where study is not null) then
        return null;
    end if;
    update studies set
        queued = studies.queued + moved.queued,
        running = studies.running + moved.running,
        succeeded = studies.succeeded + moved.succeeded,
        failed = studies.failed + moved.failed,
        cancelled = studies.cancelled + moved.cancelled,
        finished_at = case
            when studies.queued + studies.running + moved.queued + moved.running = 0 then moved.updated_at
        end,
        version = studies.version + moved.jobs,
        updated_at = moved.updated_at
    from (
        select
            new_jobs.study,
            count(*) as jobs,
            max(new_jobs.updated_at) as updated_at,
            sum((new_jobs.state = 'queued')::integer - (old_jobs.state = 'queued')::integer) as queued,
            sum((new_jobs.state = 'running')::integer - (old_jobs.state = 'running')::integer) as running,
            sum((new_jobs.state = 'succeeded')::integer - (old_jobs.state = 'succeeded')::integer) as succeeded,
            sum((new_jobs.state = 'failed')::integer - (old_jobs.state = 'failed')::integer) as failed,
            sum((new_jobs.state = 'cancelled')::integer - (old_jobs.state = 'cancelled')::integer) as cancelled
        from old_jobs join new_jobs using (seq)
        where new_jobs.study is not null and new_jobs.state <> old_jobs.state
        group by new_jobs.study
    ) as moved
    where studies.seq = moved.study;
    return null;
end
$$;
