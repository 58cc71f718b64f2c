"""Why something that was asked of the services is not done.

    SceneError
    └── ServiceError
        ├── Unauthorized             no token, or none that is good
        ├── Forbidden                the caller may not do this
        ├── WrongState               not in the state that rows or connections are in now
        ├── Gone                     it was there and will not come back
        ├── TooLarge                 more bytes, or entries, than are taken
        ├── TooManyRequests          more often than is allowed
        ├── Unavailable              not now; later
        ├── LivesElsewhere           another gateway answers this
        ├── ProviderFault            what the provider of logins says cannot be trusted
        ├── Unusable                 what was sent cannot be used for this
        ├── ProtocolViolation        a client does not keep to the protocol it speaks
        └── WorkerDied               a job's process ended too often

Nothing here knows HTTP: services.problems maps every class to a status and a problem type. What is
not found is `db.errors.NotFound`, and a value that breaks a rule is `scene.errors.InvalidInput`.
A message says the rule, the value received and how to mend it.
"""

from __future__ import annotations

from scene.errors import SceneError


class ServiceError(SceneError):
    """Root of the errors of this package."""


class Unauthorized(ServiceError):
    """There is no token, or it is not one of this server's that is still good."""


class Forbidden(ServiceError):
    """The caller may not do this."""


class ScopeMissing(Forbidden):
    """The token lacks a scope."""

    def __init__(self, message: str, scope: str) -> None:
        super().__init__(message)
        self.scope = scope
        """What the token would need."""


class QuotaReached(Forbidden):
    """The account has as much as it may have."""


class NotOwner(Forbidden):
    """What is asked for belongs to another account."""


class OtherMeeting(Forbidden):
    """The token opens another meeting only."""


class AccessNotOpen(Forbidden):
    """This server has no guests."""


class LoginNotOffered(Forbidden):
    """Nobody logs in at this server by a provider."""


class LoginDenied(Forbidden):
    """The provider has not logged the caller in."""


class NoSeat(Forbidden):
    """The token is not one that joining gave."""


class SeatReleased(Forbidden):
    """The token's seat was released, or has lapsed."""


class AwaitingAdmission(Forbidden):
    """The host has not admitted the caller yet."""


class AdmissionDenied(Forbidden):
    """The host has denied the caller admission."""


class RemovedFromMeeting(Forbidden):
    """The host has removed the caller."""


class AdmissionEnded(Forbidden):
    """The caller was admitted to a meeting that is over."""


class InvitationRenewed(Forbidden):
    """The caller came by an invitation that the host has renewed since."""


class ViewerMayNotSpeak(Forbidden):
    """Viewers neither talk nor write nor present."""


class HostCommand(Forbidden):
    """Only the host may send this command."""


class NotTakingPart(Forbidden):
    """The caller has no seat in the meeting, or only looks on."""


class NotHost(Forbidden):
    """Only the host of a meeting may change where it is held."""


class NotPresenting(Forbidden):
    """The caller is not the presenter, whose screen alone is shown."""


class NotInMeeting(Forbidden):
    """The model does not stand in the token's meeting."""


class NoConsent(Forbidden):
    """The person does not consent to what is asked, or no longer."""


class NotInRecording(Forbidden):
    """The caller neither asked for the recording nor agreed to it."""


class WrongState(ServiceError):
    """This cannot be done in the state that things are in now."""


class JobOver(WrongState):
    """A job that has ended cannot be cancelled."""


class NotResumable(WrongState):
    """The job cannot be resumed."""


class SequenceInUse(WrongState):
    """A job works on the sequence."""


class NotCaptured(WrongState):
    """The sequence's capture has not succeeded yet."""


class MeetingFull(WrongState):
    """The meeting has as many performers as it may."""


class MeetingSealed(WrongState):
    """The server cannot do this in a sealed meeting, whose motion it cannot read."""


class TargetIsHost(WrongState):
    """The host cannot do this to themselves."""


class NothingRecorded(WrongState):
    """Nobody has asked whether the meeting may be recorded."""


class StillRecording(WrongState):
    """The recording has not ended."""


class NoOwnPerson(WrongState):
    """The account has no person to keep something under."""


class DrivenElsewhere(WrongState):
    """A newer channel drives the performer."""


class NotKeepable(WrongState):
    """No pictures can be kept of whom the connection drives, if it drives anybody."""


class NothingKept(WrongState):
    """There are no pictures to learn from."""


class WrongOffset(WrongState):
    """A piece does not begin where the last piece of its upload ended."""

    def __init__(self, message: str, offset: int, length: int) -> None:
        super().__init__(message)
        self.offset, self.length = offset, length
        """Bytes that have come, bytes of the whole file."""


class Gone(ServiceError):
    """It was there and will not come back."""


class MeetingOver(Gone):
    """The meeting was ended."""


class ClipGone(Gone):
    """A job's clip, or the frames captured from it, are no longer stored."""


class TooLarge(ServiceError):
    """More bytes, or entries, than are taken."""


class TooManyRequests(ServiceError):
    """A caller asks more often than is allowed."""

    def __init__(self, message: str, retry_after_s: int) -> None:
        super().__init__(message)
        self.retry_after_s = retry_after_s


class Unavailable(ServiceError):
    """This cannot be had now; later it may."""

    def __init__(self, message: str, retry_after_s: int) -> None:
        super().__init__(message)
        self.retry_after_s = retry_after_s


class NoSeatFree(Unavailable):
    """Every seat of the meeting is taken."""


class ServerFull(Unavailable):
    """This server has as many connections of a kind as it may."""

    def __init__(self, message: str, retry_after_s: int = 5) -> None:
        super().__init__(message, retry_after_s)


class RenderersAway(Unavailable):
    """What draws for viewers cannot be started."""


class Draining(Unavailable):
    """This gateway is about to end."""


class ProviderAway(Unavailable):
    """The provider by which people log in does not answer."""


class LandmarkModelMissing(Unavailable):
    """The server has no landmark network and cannot get it."""


class LivesElsewhere(ServiceError):
    """The meeting's voices and pictures are on another gateway."""

    def __init__(self, message: str, address: str) -> None:
        super().__init__(message)
        self.address = address
        """Where the same is answered."""


class ProviderFault(ServiceError):
    """The provider by which people log in does not answer as it must."""


class Unusable(ServiceError):
    """What was sent cannot be used for this."""


class WrongHash(Unusable):
    """The bytes that came are not those that were announced."""


class KeypointsOnly(Unusable):
    """A sequence of keypoints has no pictures to train from."""


class OfferRefused(Unusable):
    """The SDP offer cannot be answered."""


class ProtocolViolation(ServiceError):
    """A client does not keep to the protocol it speaks."""


class InvalidForm(ProtocolViolation):
    """The body is not a form with a file."""


class LoginStale(ProtocolViolation):
    """The caller comes back from a login that this browser did not begin, or too late."""


class HelloExpected(ProtocolViolation):
    """The first message of a control channel is not `hello`."""


class HelloRepeated(ProtocolViolation):
    """A control channel says `hello` again."""


class BadCandidate(ProtocolViolation):
    """An ICE candidate cannot be parsed."""


class NoIceRestart(ProtocolViolation):
    """A client asks for an ICE restart, which is not supported."""


class PreconditionRequired(ProtocolViolation):
    """A change of a session comes without the session's tag."""


class PreconditionFailed(ProtocolViolation):
    """A change of a session comes with another session's tag."""


class UnsupportedMediaType(ProtocolViolation):
    """The body is of another type than asked for."""


class WorkerDied(ServiceError):
    """A job's process ended too often."""
