CALLS={}
class CallKind: pass
