-- A job that starts advances the virtual time of its owner and priority (see turns.rs) by trigger: one statement less
-- at every start.
create trigger queue_starts_update after update of state on jobs
when old.state = 'queued' and new.state = 'running'
begin
    insert into queue_starts (owner, priority, turn) values (new.owner, new.priority, new.turn)
    on conflict (owner, priority) do update set
        turn = case when excluded.turn > queue_starts.turn then excluded.turn else queue_starts.turn end;
end;
