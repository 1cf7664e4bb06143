-- The method of a job is written with its row, and not by a change of the row at every submission.
drop trigger job_methods;

-- Of a job without labels none is looked for at every change of its state.
drop trigger job_labels_follow_state;
create trigger job_labels_follow_state after update of state on jobs
when new.state <> old.state and new.labels <> '{}'
begin
    update job_labels set state = new.state where job = new.seq;
end;
