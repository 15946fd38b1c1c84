"""A digital twin: a stream of joint states, shown live, compared with a plan and with its certified corridor."""
