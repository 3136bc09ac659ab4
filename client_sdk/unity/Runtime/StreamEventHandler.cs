namespace Terraport.Unity
{
    /// <summary>Listens to a stream's events. By reference, since they are large and come often: nothing is copied or allocated.</summary>
    /// <param name="next">The event; valid within the call.</param>
    public delegate void StreamEventHandler(ref StreamEvent next);
}
