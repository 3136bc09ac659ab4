using System;
using UnityEngine;

namespace Terraport.Unity
{
    /// <content>How what happens in the session becomes events of the component.</content>
    public sealed partial class TerraportScene
    {
        private void OnLoaded(SceneFiles files)
        {
            // First, since what a listener asks for is newer.
            if (hasPendingLanding)
            {
                hasPendingLanding = false;
                try
                {
                    session.Stage.Land(pendingPosition, pendingRadiusM, pendingOptions);
                }
                catch (ArgumentException error)
                {
                    Fail(new TerraportException("bad_landing", error.Message, null, error)); // Whoever asked is gone.
                }
            }
            if (Loaded != null)
            {
                Loaded(files);
            }
        }

        private void OnSwapped(SceneSwap swap)
        {
            if (Shown != null)
            {
                Shown(swap);
            }
            if (swap.Landing > 0 && !swap.IsDegraded)
            {
                onShown.Invoke();
            }
        }

        private void OnPresentable(int landing)
        {
            if (Presentable != null)
            {
                Presentable(landing);
            }
        }

        /// <summary>Raise the component's own event for one of the stream's, then pass the stream's on.</summary>
        private void OnStreamed(ref StreamEvent next)
        {
            // 1. Kinds that have an event of their own. Shown is not among them: it comes from the stage, which knows when it is drawn.
            switch (next.Kind)
            {
                case StreamEventKind.Link: OnLink(next.Link); break;
                case StreamEventKind.Planned:
                    if (Planned != null)
                    {
                        Planned(next.Plan);
                    }
                    break;
                case StreamEventKind.Ready:
                    if (Ready != null)
                    {
                        Ready(next.Landing ?? 0);
                    }
                    break;
                case StreamEventKind.Degraded:
                    if (Degraded != null)
                    {
                        Degraded(next.Landing ?? 0);
                    }
                    onDegraded.Invoke();
                    break;
                case StreamEventKind.Picked:
                    if (Picked != null)
                    {
                        Picked(next.Request, next.Hit);
                    }
                    break;
                case StreamEventKind.PickRefused:
                    if (Picked != null)
                    {
                        Picked(next.Request, null);
                    }
                    break;
                case StreamEventKind.Refused: Fail(new TerraportException(next.Code, next.Message)); break;
                default: break;
            }
            // 2. Every event as it is, last: a listener finds all that the component has to say of it said.
            if (Streamed != null)
            {
                Streamed(ref next);
            }
        }

        private void OnLink(LinkState state)
        {
            link = state;
            if (LinkChanged != null)
            {
                LinkChanged(state);
            }
            if (state.Phase == LinkPhase.Closed)
            {
                Fail(new TerraportException(state.Code, state.Message, state.CloseCode, null));
            }
        }

        private void Fail(TerraportException error)
        {
            if (Failed != null)
            {
                Failed(error);
            }
            else
            {
                Debug.LogWarning("terraport: " + error.Code + ": " + error.Message, this);
            }
            onFailed.Invoke(error.Message);
        }
    }
}
